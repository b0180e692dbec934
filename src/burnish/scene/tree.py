"""A scene as a tree of plugins and their properties, before anything is built.

It is Mitsuba's own parser (XML with defaults, includes and older versions; nested
dictionaries), stopped before the steps that merge equal plugins and meshes: there shapes
would lose their identity. Files named in it are made absolute and checked here, so that
what is missing is reported with the place in the scene file.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.core.errors import BurnishError, InvalidValue, MissingFile, SceneError

Reference = mi.Properties.ResolvedReference


@dataclass
class Tree:
    """The nodes of a scene.

    state: Mitsuba's parser state, references resolved to node numbers; node 0 is the scene.
    label: what error messages call the scene (file name, example name or "the dictionary").
    """

    config: Any
    state: Any
    label: str

    @staticmethod
    def from_file(path: Path, parameters: Mapping[str, object]) -> Tree:
        """Read Mitsuba 3 XML. Raises MissingFile, SceneError or InvalidValue."""
        if not path.is_file():
            raise MissingFile(f"no scene file {str(path)!r}; check the path")
        config = mi.parser.ParserConfig(mi.variant())
        with _resolving(path.resolve().parent), _explained(str(path)):
            state = mi.parser.parse_file(
                config, str(path), **{name: str(value) for name, value in parameters.items()}
            )
        return Tree._prepared(config, state, str(path), path.resolve().parent)

    @staticmethod
    def from_dict(scene: Mapping[str, Any], label: str) -> Tree:
        """Read a Mitsuba scene dictionary; relative files start at the working folder."""
        config = mi.parser.ParserConfig(mi.variant())
        with _explained(label):
            state = mi.parser.parse_dict(config, dict(scene))
        return Tree._prepared(config, state, label, Path.cwd())

    @staticmethod
    def _prepared(config: Any, state: Any, label: str, folder: Path) -> Tree:
        with _explained(label):
            mi.parser.transform_upgrade(config, state)
            mi.parser.transform_resolve(config, state)
        tree = Tree(config, state, label)
        if tree.node(0).type != mi.ObjectType.Scene:
            raise SceneError(
                f"{label}: the outermost element is a {tree.plugin(0)!r}, not a scene; "
                "enclose it in <scene version='3.0.0'>"
            )
        tree._check_reachable()
        with _resolving(folder):
            tree._make_files_absolute(folder)
        return tree

    # -- looking --------------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self.state.nodes)

    def node(self, index: int) -> Any:
        """The parser's node: `.type`, `.props`."""
        return self.state.nodes[index]

    def plugin(self, index: int) -> str:
        """A node's plugin, such as "roughconductor"."""
        return str(self.node(index).props.plugin_name())

    def id(self, index: int) -> str:
        """A node's explicit id, or ""."""
        return str(self.node(index).props.id())

    def children(self, index: int, kind: Any = None) -> list[tuple[str, int]]:
        """(property name, node number) of a node's child plugins, of one type if given."""
        props = self.node(index).props
        found = []
        for name in props:
            value = props[name]
            if isinstance(value, Reference) and kind in (None, self.node(value.index()).type):
                found.append((name, value.index()))
        return found

    def embedded(self, index: int) -> list[tuple[str, Any]]:
        """(property name, object) of ready-made Mitsuba objects, as a dictionary may hold."""
        props = self.node(index).props
        return [(name, props[name]) for name in props if isinstance(props[name], mi.Object)]

    def place(self, index: int) -> str:
        """Where a node stands: file, line and column, or the path in the dictionary."""
        if self.state.node_paths:
            path = self.state.node_paths[index] if index < len(self.state.node_paths) else ""
            return f"{self.label}, {path!r}" if path else self.label
        return str(mi.parser.file_location(self.state, self.node(index)))

    def as_dict(self, index: int) -> dict[str, Any]:
        """A node and everything below it as a dictionary that `mi.load_dict` takes."""
        result: dict[str, Any] = {"type": self.plugin(index)}
        props = self.node(index).props
        for name in props:
            value = props[name]
            if isinstance(value, Reference):
                result[name] = self.as_dict(value.index())
            elif isinstance(value, mi.ScalarColor3d):
                result[name] = {"type": "rgb", "value": [float(channel) for channel in value]}
            elif isinstance(value, mi.Spectrum):
                result[name] = _spectrum(value)
            else:
                result[name] = value
        return result

    def digest(self) -> str:
        """SHA-256 of everything that the scene is made of, contents of its files included."""
        digest = hashlib.sha256()
        for index in range(len(self)):
            props = self.node(index).props
            digest.update(f"\n{index} {self.plugin(index)} {self.id(index)}".encode())
            for name in props:
                value = props[name]
                digest.update(f"\n{name} ".encode())
                if names_file(name, value):
                    digest.update(hashlib.sha256(Path(value).read_bytes()).digest())
                elif isinstance(value, mi.Object):
                    for key, item in mi.traverse(value):
                        digest.update(key.encode() + np.asarray(item).tobytes())
                elif isinstance(value, mi.Spectrum):
                    digest.update(str(_spectrum(value)).encode())
                else:
                    digest.update(str(value).encode())
        return digest.hexdigest()

    def _named_in(self, message: str) -> str:
        """The id of the shape whose place an error message names, or ""."""
        for index in range(len(self)):
            if self.node(index).type == mi.ObjectType.Shape:
                place = str(mi.parser.file_location(self.state, self.node(index)))
                path = self.state.node_paths[index] if self.state.node_paths else ""
                if (place and place in message) or (path and f'"{path}"' in message):
                    return self.id(index)
        return ""

    # -- changing -------------------------------------------------------------------------

    def add(self, kind: Any, plugin: str) -> int:
        """A new node that nothing refers to yet; returns its number."""
        node = mi.parser.SceneNode()
        node.type = kind
        node.props = mi.Properties(plugin)
        self.state.nodes.append(node)
        return len(self) - 1

    def remove_children(self, index: int, kind: Any) -> None:
        """Detach the child plugins of one type."""
        for name, _ in self.children(index, kind):
            del self.node(index).props[name]

    def flatten_merged(self) -> dict[int, list[int]]:
        """Put the shapes of `merge` plugins directly into the scene, where they stay apart.

        Returns the shape nodes of each merge node.
        """
        groups: dict[int, list[int]] = {}
        root = self.node(0).props
        for name, index in self.children(0, mi.ObjectType.Shape):
            if self.plugin(index) == "merge":
                del root[name]
                groups[index] = list(self._leaves(index))
                for shape in groups[index]:
                    root[f"merged_{shape}"] = Reference(shape)
        return groups

    def _leaves(self, index: int) -> Iterator[int]:
        if self.plugin(index) != "merge":
            yield index
            return
        for _, child in self.children(index, mi.ObjectType.Shape):
            yield from self._leaves(child)

    def replaced(self, bsdfs: Mapping[int, Any]) -> Tree:
        """A copy in which shapes (by node number) have the given ready-made BSDFs."""
        tree = Tree(self.config, mi.parser.ParserState(self.state), self.label)
        for index, bsdf in bsdfs.items():
            props = tree.node(index).props
            tree.remove_children(index, mi.ObjectType.BSDF)
            for name, value in tree.embedded(index):
                if isinstance(value, mi.BSDF):
                    del props[name]
            props["burnish_bsdf"] = bsdf
        return tree

    def build(self) -> Any:
        """Make the scene: mi.Scene, nothing merged. Raises SceneError with the place."""
        state = mi.parser.ParserState(self.state)
        for node in state.nodes:
            node.props = _unread(node.props)
        with _explained(self.label, self):
            return mi.parser.instantiate(self.config, state)

    # -- checks ---------------------------------------------------------------------------

    def _check_reachable(self) -> None:
        """A shape whose name another one takes would vanish without a word."""
        reached = {value for index in range(len(self)) for _, value in self.children(index)}
        for index in range(1, len(self)):
            if self.node(index).type == mi.ObjectType.Shape and index not in reached:
                raise SceneError(
                    f"{self.place(index)}: another shape has the same name and hides this one; "
                    "give each its own name or id"
                )

    def _make_files_absolute(self, folder: Path) -> None:
        for index in range(len(self)):
            props = self.node(index).props
            for name in list(props):
                if not names_file(name, props[name]):
                    continue
                given = str(props[name])
                found = self._find(given, folder, index)
                if found is None:
                    raise MissingFile(
                        f"{self.place(index)}: no file {given!r}; put it there, or correct the "
                        f"path (relative paths start at {folder})"
                    )
                props[name] = str(found)

    def _find(self, given: str, folder: Path, index: int) -> Path | None:
        """A named file: beside the scene, beside the include that names it, or where
        Mitsuba looks (its data folder, <path> elements)."""
        candidates = [folder / given]
        files = self.state.files
        if files:
            candidates.append(
                Path(str(files[self.node(index).file_index])).resolve().parent / given
            )
        candidates.append(Path(str(mi.file_resolver().resolve(given))))
        return next((path.resolve() for path in candidates if path.is_file()), None)


class UniqueNames:
    """Hands out each name once: "white", "white_2", "white_3"."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def __call__(self, name: str) -> str:
        candidate, number = name, 1
        while candidate in self._taken:
            number += 1
            candidate = f"{name}_{number}"
        self._taken.add(candidate)
        return candidate


def names_file(name: str, value: object) -> bool:
    """Whether a property names a file."""
    return isinstance(value, str) and (name == "filename" or name.endswith("_filename"))


def _unread(props: Any) -> Any:
    """The same properties, none marked as read: those that a plugin does not know then show."""
    fresh = mi.Properties(props.plugin_name())
    fresh.set_id(props.id())
    for name in props:
        fresh[name] = props[name]
    return fresh


def _spectrum(value: Any) -> dict[str, Any]:
    if value.is_uniform():
        return {"type": "uniform", "value": float(value.values[0])}
    pairs = list(zip(map(float, value.wavelengths), map(float, value.values), strict=True))
    return {"type": "spectrum", "value": pairs}


@contextmanager
def _resolving(folder: Path) -> Iterator[None]:
    """Let Mitsuba look for relative files in a folder first."""
    before = mi.file_resolver()
    resolver = mi.FileResolver(before)
    resolver.prepend(str(folder))
    mi.set_file_resolver(resolver)
    try:
        yield
    finally:
        mi.set_file_resolver(before)


@contextmanager
def _explained(label: str, tree: Tree | None = None) -> Iterator[None]:
    """Turn Mitsuba's exceptions into one-line errors with the place and a remedy."""
    try:
        yield
    except BurnishError:
        raise
    except Exception as error:
        raise _translated(str(error), label, tree) from error


def _translated(message: str, label: str, tree: Tree | None) -> BurnishError:
    """The error that says in one line what Mitsuba said in several."""
    text = re.sub(r"\[[\w.]+:\d+\]\s*", "", message)
    text = re.sub(r"\x1b\[[\d;]*m", "", text)
    text = re.sub(r"(?:Error w|W)hile loading \"?([^\"\n]*?)\"?(?= \(line|:)", r"\1", text)
    text = re.sub(r"^At (?=\S)", "", text)
    text = re.sub(r":\s*\n\s*-\s*", ": ", text)
    text = re.sub(r"\n\s*-\s*", ", ", text)
    text = " ".join(text.split()).rstrip(".")
    unused = re.search(r"unused parameters: (.*)", text)
    if unused:
        return InvalidValue(f"{label} has no parameter {unused[1]}; leave it out")
    text = re.sub(r"(\. )?Make sure the object with id=\S+ exists", "", text)
    if "included file" in text:
        return MissingFile(f"{text.rsplit('<include>: ')[-1]}; put it there or correct its name")
    name = tree._named_in(message) if tree is not None else ""
    if name:
        text = f"object {name!r}: {text}"
    if label not in text:
        text = f"{label}: {text}"
    for pattern, remedy in _REMEDIES:
        if re.search(pattern, text):
            return SceneError(f"{text}; {remedy}")
    return SceneError(f"{text}; correct the scene there")


_REMEDIES = (
    (r"undefined parameter", "give it a value (-D name=value) or a <default> in the file"),
    (r"[Uu]nresolved reference", "define an object with that id"),
    (r"Plugin \"[^\"]*\" not found", "check the type's spelling; Mitsuba 3 has no such plugin"),
    (r"unreferenced propert", "remove or correct what the plugin does not know"),
    (r"duplicate ID", "give each object its own id"),
    (r"invalid vertex position", "the mesh has NaN or infinite vertices: repair or export it anew"),
    (r"while loading (OBJ|PLY)|loading (OBJ|PLY) file|[Ss]erialized", "export the mesh anew"),
    (r"Parsing of XML", "correct the XML there"),
)
