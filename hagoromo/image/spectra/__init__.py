"""Reflectance spectra of marked regions of photographs, their colours under any lamp, plot and files."""
