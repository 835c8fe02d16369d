"""Gallery: every recipe in pictures, and what it costs."""
