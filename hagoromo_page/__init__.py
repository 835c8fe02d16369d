"""Pages: the viewer in the browser, published pages, and reports."""
