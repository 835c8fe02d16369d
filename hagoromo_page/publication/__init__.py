"""Publication: a measured object as a page that anybody can open and relight in a browser."""
