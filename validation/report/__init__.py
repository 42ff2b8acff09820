"""What people look at: pages, figures and films."""
