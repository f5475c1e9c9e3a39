"""Names that growers may give to plants, though programs stumble over such names."""

from __future__ import annotations

from dataclasses import replace

from grape.site import Site

NAMES = (
    "Müller 12", "<b>x", "[red]y", "[/b]", "a/b", "..", "e\u0301", "12", "🍇" * 80, "p" + 78 * " " + "q",
    "ground", "world", "r0/post1",
)  # fmt: skip


def with_names(site: Site, names: tuple[str, ...] = NAMES) -> Site:
    """The site with its first plants called so."""
    renamed = tuple(replace(plant, id=name) for plant, name in zip(site.plants, names, strict=False))
    return replace(site, plants=renamed + site.plants[len(names) :])
