from .bsdf import bsdf as bsdf
from .plugin import register as register
