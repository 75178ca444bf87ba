"""The effects that a scene can call for, one small file each."""

from model.effects.base import Effect
from model.effects.exact_tendons import ExactTendons
from model.effects.extension import Extension
from model.effects.neo_hookean import NeoHookean
from model.effects.printed import PrintedStatics

__all__ = ["Effect", "ExactTendons", "Extension", "NeoHookean", "PrintedStatics"]
