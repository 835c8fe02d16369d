"""How nodes of a field send light on: colours and gloss, the lamps of each photograph, light that is not known."""
