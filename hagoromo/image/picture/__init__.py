"""An image after it is rendered: its record and files, how it is shown, what it states of its error, comparison."""
