"""The laboratory: a window in the browser, from a folder of photographs to the published page, by commands it shows."""
