#!/usr/bin/env python3
"""Writes docs/reference/python.md from the sources of the Python package, without importing it.

    docs/tools/python_reference.py [FILE]

A test compares the committed page with what this writes.
"""

from __future__ import annotations

import ast
import inspect
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "python/package/brdfarm"
PAGE = ROOT / "docs/reference/python.md"
HEAD = "<!-- Written by docs/tools/python_reference.py. Do not edit: see CONTRIBUTING.md. -->"

Function = ast.FunctionDef | ast.AsyncFunctionDef


def parse(module: str) -> ast.Module:
    """A module of the package; of the native half the stub."""
    paths = [PACKAGE / f"{module}{ending}" for ending in (".py", ".pyi")]
    path = next(path for path in paths if path.exists())
    return ast.parse(path.read_text())


def cleaned(text: str) -> str:
    """A docstring as Markdown: indented code becomes a block of code."""
    out: list[str] = []
    code: list[str] = []
    for line in inspect.cleandoc(text).splitlines() + [""]:
        if line.startswith("    ") or (code and not line):
            code.append(line[4:])
            continue
        if code:
            out += ["```python", *"\n".join(code).rstrip().splitlines(), "```", ""]
            code = []
        out.append(line)
    if code:
        out += ["```python", *"\n".join(code).rstrip().splitlines(), "```"]
    return "\n".join(out).strip()


def string(node: ast.stmt | None) -> str | None:
    """The text of a statement that is only a text."""
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        value = node.value.value
        return value if isinstance(value, str) else None
    return None


def named(node: ast.stmt) -> str | None:
    """The name that a statement defines."""
    if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        return node.name
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        return node.target.id
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
        return node.targets[0].id
    return None


def argument(node: ast.arg, default: ast.expr | None) -> str:
    text = node.arg + (f": {ast.unparse(node.annotation)}" if node.annotation else "")
    if default is None:
        return text
    return f"{text} = {ast.unparse(default)}" if node.annotation else f"{text}={ast.unparse(default)}"


def arguments(node: ast.arguments) -> list[str]:
    """Each argument of a call, without `self` or `cls`."""
    plain = [*node.posonlyargs, *node.args]
    defaults: list[ast.expr | None] = [*[None] * (len(plain) - len(node.defaults)), *node.defaults]
    pairs = zip(plain, defaults, strict=True)
    parts = [argument(*pair) for pair in pairs if pair[0].arg not in ("self", "cls")]
    if node.vararg:
        parts.append(f"*{argument(node.vararg, None)}")
    elif node.kwonlyargs:
        parts.append("*")
    parts += [argument(*pair) for pair in zip(node.kwonlyargs, node.kw_defaults, strict=True)]
    if node.kwarg:
        parts.append(f"**{argument(node.kwarg, None)}")
    return parts


def signature(function: Function, name: str) -> str:
    """The call as a reader writes it."""
    returns = f" -> {ast.unparse(function.returns)}" if function.returns else ""
    parts = arguments(function.args)
    line = f"{name}({', '.join(parts)}){returns}"
    if len(line) <= 88:
        return line
    return f"{name}(\n" + "".join(f"    {part},\n" for part in parts) + f"){returns}"


def decorators(node: Function | ast.ClassDef) -> set[str]:
    names = (ast.unparse(decorator).partition("(")[0] for decorator in node.decorator_list)
    return set(names)


SPECIAL = {"__len__": "len({})", "__getitem__": "{}[material, view]"}


def method(cls: ast.ClassDef, function: Function) -> str | None:
    """The section of a method or a property; None for what is private or has no docstring."""
    text = ast.get_docstring(function)
    is_private = function.name.startswith("_") and function.name not in SPECIAL
    if text is None or is_private:
        return None
    owner = cls.name.lower()
    kinds = decorators(function)
    if function.name in SPECIAL:
        returns = ast.unparse(function.returns) if function.returns else "None"
        line = f"{SPECIAL[function.name].format(owner)} -> {returns}"
        title = f"`{SPECIAL[function.name].format(owner)}`"
    elif kinds & {"property", "cached_property"}:
        returns = ast.unparse(function.returns) if function.returns else "Any"
        line = f"{owner}.{function.name}: {returns}"
        title = f"`{cls.name}.{function.name}`"
    else:
        owner = cls.name if kinds & {"classmethod", "staticmethod"} else owner
        line = signature(function, f"{owner}.{function.name}")
        title = f"`{cls.name}.{function.name}`"
    return f"### {title}\n\n```python\n{line}\n```\n\n{cleaned(text)}\n"


def fields(cls: ast.ClassDef) -> list[tuple[str, str, str, str]]:
    """The public attributes: name, type, default and meaning."""
    found = []
    for node, after in zip(cls.body, [*cls.body[1:], None], strict=True):
        name = named(node)
        if not isinstance(node, ast.AnnAssign) or name is None or name.startswith("_"):
            continue
        meaning = " ".join((string(after) or "").split())
        default = ast.unparse(node.value) if node.value else ""
        found.append((name, ast.unparse(node.annotation), default, meaning))
    return found


def call_of_fields(cls: ast.ClassDef) -> str | None:
    """How a dataclass that readers make themselves is called."""
    makes = any(isinstance(node, ast.FunctionDef) and node.name == "__post_init__" for node in cls.body)
    if not makes:
        return None
    parts = []
    for name, annotation, default, _ in fields(cls):
        if "kw_only=True" in default:
            parts.append("*")
        value = " = None" if "default=None" in default else ""
        parts.append(f"{name}: {annotation}{value}")
    return f"{cls.name}(\n" + "".join(f"    {part},\n" for part in parts) + ")"


def class_section(cls: ast.ClassDef) -> str:
    text = f"## `{cls.name}`\n\n"
    if (call := call_of_fields(cls)) is not None:
        text += f"```python\n{call}\n```\n\n"
    init = next((node for node in cls.body if named(node) == "__init__"), None)
    if isinstance(init, ast.FunctionDef) and init.args.args[1:]:
        text += f"```python\n{signature(init, cls.name).removesuffix(' -> None')}\n```\n\n"
    text += cleaned(ast.get_docstring(cls) or "") + "\n\n"
    rows = fields(cls)
    if rows:
        text += "| attribute | type | meaning |\n| --- | --- | --- |\n"
        for name, annotation, _, meaning in rows:
            escaped = annotation.replace("|", r"\|")
            text += f"| `{name}` | `{escaped}` | {meaning} |\n"
        text += "\n"
    functions = [node for node in cls.body if isinstance(node, Function)]
    sections = [section for node in functions if (section := method(cls, node)) is not None]
    return text + "\n".join(sections)


def value_section(name: str, node: ast.stmt, text: str) -> str:
    return f"## `{name}`\n\n```python\n{ast.unparse(node)}\n```\n\n{cleaned(text)}\n"


def section(name: str, module: str) -> str:
    """The section of a name that the package exports."""
    body = parse(module).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        if named(node) != name:
            continue
        if isinstance(node, ast.ClassDef):
            return class_section(node)
        if isinstance(node, ast.FunctionDef):
            text = cleaned(ast.get_docstring(node) or "")
            return f"## `{name}`\n\n```python\n{signature(node, name)}\n```\n\n{text}\n"
        return value_section(name, node, string(after) or "")
    raise SystemExit(f"{module} does not define {name}")


def page() -> str:
    """The whole page: functions first, then classes, then values."""
    init = parse("__init__")
    modules = {
        alias.name: (node.module or "").removeprefix("brdfarm.")
        for node in init.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    order = {"f": 0, "c": 1, "v": 2}

    def kind(name: str) -> int:
        return order["v" if name.isupper() else "c" if name[0].isupper() else "f"]

    exported = next(node for node in init.body if named(node) == "__all__")
    assert isinstance(exported, ast.Assign)
    names = sorted(ast.literal_eval(exported.value), key=lambda name: (kind(name), name))
    introduction = cleaned(ast.get_docstring(init) or "")
    sections = [section(name, modules[name]).rstrip() for name in names]
    return "\n\n".join([HEAD, "# The Python package", introduction, *sections]) + "\n"


if __name__ == "__main__":
    Path(sys.argv[1] if len(sys.argv) > 1 else PAGE).write_text(page())
