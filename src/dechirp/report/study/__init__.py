"""Report of a study: the page, its figures and tables."""
