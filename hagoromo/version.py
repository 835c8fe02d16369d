"""Version of the package, for the records that results carry."""

__version__ = "0.1.0"
