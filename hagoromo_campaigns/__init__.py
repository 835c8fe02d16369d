"""Campaigns: two measurements of one object, at two dates: what has changed, and how surely."""
