"""Drape: sheets of cloth that fall over bodies and settle, and the charts of where they lie."""
