"""Version of the package, for the wheel and for the records that results carry. CITATION.cff repeats it."""

__version__ = "0.3.0"
