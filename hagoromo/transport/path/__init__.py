"""All orders of light by paths: an unbiased Monte Carlo estimate, beside the march (MODEL §1)."""
