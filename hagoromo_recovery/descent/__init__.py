"""The steps in which matter, colours, gloss, lamps and cameras move until they explain the photographs."""
