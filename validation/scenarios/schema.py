def schema():
    """Placeholder until written below."""
    return {}
