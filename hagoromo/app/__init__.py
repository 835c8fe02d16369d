"""The program around the package: command line, demo and report."""
