"""What is in a folder."""


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
