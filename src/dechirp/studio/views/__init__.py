"""What the page shows of a moment: a family, a file a view."""
