"""Matter that fills volume boxes: cloth, drape, skin, feather, hair, solids, the figures of the paper, and its demo.

Each kind of recipe is an entry point of the group `hagoromo.matter`, see `hagoromo/matter/recipe.py`.
"""
