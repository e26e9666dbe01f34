"""The law of motion: forces, regimes and equations, for any method and kind of number."""

from mm_gym.law.bouc_wen import BOUC_WEN
from mm_gym.law.interface import Interface
from mm_gym.law.magnetorheological import MAGNETORHEOLOGICAL
from mm_gym.law.stribeck import STRIBECK

INTERFACES: dict[str, Interface] = {
    one.kind: one for one in (STRIBECK, BOUC_WEN, MAGNETORHEOLOGICAL)
}
"""The interfaces in value form, by the kind that a scene asks for. The others, in `dry_friction`,
are lines in each regime: the exact methods know more of them than their value."""
