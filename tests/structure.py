#!/usr/bin/env python3
"""Checks the structure of the workspace; see ARCHITECTURE.md.

- A crate depends only on the crates that ALLOWED lists for it (dev-dependencies are free).
- The files of a crate do not import each other in a circle.
- No Rust file has more than MOST_LINES lines.

An import is a path through `crate`, `super`, `self` or a child module, in a `use` or in code. Declarations
(`mod x;`) and re-exports (`pub use`) are not imports; an import of a re-export is one of the file that defines
it. Test modules are not checked.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MOST_LINES = 500
ALLOWED = {
    "simulator": "",
    "durable": "",
    "config": "",
    "plot": "",
    "maze": "simulator",
    "simulators": "maze simulator",
    "wire": "simulator",
    "graph": "durable",
    "nets": "durable",
    "runs": "config durable",
    "trace": "durable simulator",
    "dataset": "config durable maze simulator simulators",
    "agents": "config dataset graph maze nets simulator simulators",
    "report": "agents config graph maze plot runs simulator simulators trace",
    "actor": "agents config dataset durable maze nets simulator simulators trace wire",
    "graph-builder": "agents config dataset durable graph maze simulator wire",
    "learner": "agents config dataset durable graph maze nets simulator wire",
    "launcher": "*",
    "system-tests": "",
}

# A path: `crate::a::b`, `super::a`; in a `use` also `a::{b, c::d}`.
PREFIXED = re.compile(r"\b(?:crate|self|super)(?:\s*::\s*\w+)+")
USE = re.compile(r"^[ \t]*(pub(?:\([^)]*\))?\s+)?use\s+([^;]+);", re.M)
DECLARED = re.compile(r"^[ \t]*(#\[cfg\(test\)\]\s*)?(?:pub(?:\([^)]*\))?\s+)?mod\s+(\w+)\s*;", re.M)
INLINE_TESTS = re.compile(r"^#\[cfg\(test\)\]\n(?:pub(?:\([^)]*\))? )?mod \w+ \{.*?^\}", re.M | re.S)
COMMENT_OR_TEXT = re.compile(r"//[^\n]*|r(#*)\".*?\"\1|\"(?:\\.|[^\"\\])*\"", re.S)


def expand(use):
    """The paths of a `use`: `a::{b, c as d}` is [(a, b), (a, c)], each with the name it gets."""
    use = use.strip()
    brace = use.find("{")
    if brace < 0:
        path, _, name = use.partition(" as ")
        segments = tuple(part.strip() for part in path.split("::") if part.strip())
        return [(segments, name.strip() or segments[-1])]
    head = tuple(part.strip() for part in use[:brace].split("::") if part.strip())
    parts, depth, part = [], 0, ""
    for c in use[brace + 1 : use.rindex("}")]:
        depth += (c == "{") - (c == "}")
        if c == "," and depth == 0:
            parts.append(part)
            part = ""
        else:
            part += c
    found = [item for part in [*parts, part] if part.strip() for item in expand(part)]
    return [(head + path, head[-1] if name == "self" else name) for path, name in found]


class Crate:
    def __init__(self, source):
        self.source = source
        self.code, self.children, self.reexports, self.files = {}, {}, {}, {}
        roots = [source / name for name in ("lib.rs", "main.rs") if (source / name).exists()]
        for root in roots:
            self.add((), root)

    def add(self, module, path):
        text = COMMENT_OR_TEXT.sub('""', path.read_text())
        text = INLINE_TESTS.sub("", text)
        names = [name for test, name in DECLARED.findall(text) if not test]
        self.files[module], self.children[module] = path, set(names)
        uses = [(public, item) for public, use in USE.findall(text) for item in expand(use)]
        self.reexports[module] = {name: path for public, (path, name) in uses if public}
        imports = [path for public, (path, _) in uses if not public]
        text = USE.sub("", text)
        imports += [tuple(re.split(r"\s*::\s*", path)) for path in PREFIXED.findall(text)]
        imports += [(name, "") for name in names if re.search(rf"(?<![\w:]){name}::", text)]
        self.code[module] = imports
        for name in names:
            base = self.source.joinpath(*module, name)
            for child in (base.with_suffix(".rs"), base / "mod.rs"):
                if child.exists():
                    self.add((*module, name), child)

    def file_of(self, module, path, seen=()):
        """The file that defines what a path in a module leads to; None outside of the crate."""
        first, *rest = path
        if first == "crate":
            at = ()
        elif first == "self":
            at = module
        elif first == "super":
            at = module[:-1]
        elif first in self.children[module]:
            at = (*module, first)
        else:
            return None
        for i, segment in enumerate(rest):
            if segment == "super":
                at = at[:-1]
            elif segment in self.children[at]:
                at = (*at, segment)
            elif segment in self.reexports[at] and (at, segment) not in seen:
                target = (*self.reexports[at][segment], *rest[i + 1 :])
                return self.file_of(at, target, (*seen, (at, segment))) or self.files[at]
            else:
                break
        return self.files[at]

    def circles(self):
        edges = {}
        for module, imports in self.code.items():
            own = self.files[module]
            targets = {self.file_of(module, path) for path in imports}
            edges[own] = {target for target in targets if target and target != own}

        def reachable(start):
            found, waiting = set(), [start]
            while waiting:
                for target in edges[waiting.pop()] - found:
                    found.add(target)
                    waiting.append(target)
            return found

        reach = {file: reachable(file) for file in edges}
        circles = {frozenset(b for b in reach[a] if a in reach[b]) for a in edges if a in reach[a]}
        return [(circle, edges) for circle in circles]


def main():
    command = ["cargo", "metadata", "--format-version", "1", "--no-deps", "--offline"]
    metadata = json.loads(subprocess.check_output(command, cwd=ROOT))
    crates = {package["name"]: package for package in metadata["packages"]}
    faults = []
    for name, package in sorted(crates.items()):
        allowed = ALLOWED.get(name)
        if allowed is None:
            faults.append(f"{name}: not in the table ALLOWED of tests/structure.py")
            continue
        allowed = set(crates) if allowed == "*" else set(allowed.split())
        for dependency in package["dependencies"]:
            used = dependency["name"]
            if used in crates and dependency["kind"] != "dev" and used not in allowed:
                faults.append(f"{name}: must not depend on {used}")
        folder = Path(package["manifest_path"]).parent
        for circle, edges in Crate(folder / "src").circles():
            names = {file: str(file.relative_to(ROOT)) for file in circle}
            faults.append(f"{name}: files import each other in a circle:")
            for file in sorted(circle):
                uses = ", ".join(sorted(names[target] for target in edges[file] & circle))
                faults.append(f"    {names[file]} imports {uses}")
    for file in sorted(ROOT.rglob("*.rs")):
        local = file.relative_to(ROOT)
        if local.parts[0] != "target":
            lines = file.read_bytes().count(b"\n")
            if lines > MOST_LINES:
                faults.append(f"{local}: {lines} lines, more than {MOST_LINES}")
    print("\n".join(faults) or "structure: no faults")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
