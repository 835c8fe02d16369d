"""Operators that stand in a menu of Blender."""

from __future__ import annotations

import bpy


class InMenu:
    """A part of the extension: an operator, and its entry in a menu. icon: a name of Blender's."""

    def __init__(self, operator: type[bpy.types.Operator], menu: type[bpy.types.Menu], icon: str) -> None:
        self.operator, self.menu, self.icon = operator, menu, icon

    def register(self) -> None:
        """The operator and its entry."""
        bpy.utils.register_class(self.operator)
        self.menu.append(self._entry)

    def unregister(self) -> None:
        """The same back."""
        self.menu.remove(self._entry)
        bpy.utils.unregister_class(self.operator)

    def _entry(self, menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
        menu.layout.operator(self.operator.bl_idname, icon=self.icon)
