"""The figures of the paper: an angel and a nun as a kind of matter, and the demo that shows them."""
