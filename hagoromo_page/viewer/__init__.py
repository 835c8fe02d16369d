"""View: a viewer in the browser, in which a scene is looked at and edited."""
