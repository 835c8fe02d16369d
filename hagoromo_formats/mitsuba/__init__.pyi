from .plugin import bsdf as bsdf
from .plugin import register as register
from .read import scene_from_mitsuba as scene_from_mitsuba
from .write import load_into_mitsuba as load_into_mitsuba
from .write import write_mitsuba as write_mitsuba
