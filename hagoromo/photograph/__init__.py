"""Photographs: linear sensor values with their variance, and folders of them."""
