"""Light before it meets anything: spectra, the colour people see, lamps."""
