"""Batch: a graph of commands over many captures; what did not change is not done again."""
