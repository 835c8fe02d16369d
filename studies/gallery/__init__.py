"""Gallery: pictures of every recipe, with time and memory of build and rendering."""
