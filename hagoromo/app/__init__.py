"""The program around the package: it parses commands, calls, and writes reports."""
