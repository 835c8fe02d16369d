"""The record of a measured material, and its file materials.json."""
