"""How many principal components Mitsuba's `principled` needs, for docs/components.md.

python -m bench.components
"""

from __future__ import annotations

import numpy as np

from burnish.materials.models.family import PrincipledFamily

ERRORS = (0.1, 0.03, 0.01, 0.003, 0.001)
SETS = (
    ("roughness",),
    ("roughness", "metallic"),
    ("roughness", "metallic", "specular", "clearcoat"),
)


def main() -> None:
    """Print the table of component count against error."""
    heads = " | ".join(f"{error:g}" for error in ERRORS)
    print(f"| parameters | members | {heads} | worst member |")
    print("|---" * (len(ERRORS) + 3) + "|")
    for varied in SETS:
        family = PrincipledFamily(varied=varied, error=min(ERRORS))
        found, members = family.components, len(family.members())
        counts = " | ".join(str(int(np.argmax(found.errors <= error)) + 1) for error in ERRORS)
        worst = found.worst[len(found.tables) - 1]
        print(f"| {', '.join(varied)} | {members} | {counts} | {worst:.1e} |")


if __name__ == "__main__":
    main()
