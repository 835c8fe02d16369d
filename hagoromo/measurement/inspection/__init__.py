"""Inspection: what a measured surface shows when it is looked at closely: profiles and maps, each with its errors."""
