# SPDX-License-Identifier: Apache-2.0
"""Makes build/site/pages and build/site/mkdocs.yml, of which `scripts/site` builds the site.

Pages are the documents, with links as the site needs them, the files that they link, and a reference: of the command
line from the program's man pages, of the Python module from its docstrings (mkdocstrings), of C++ from Doxygen's XML.
"""
import collections
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as xml

ROOT = pathlib.Path(__file__).resolve().parents[2]
SITE = ROOT / "build/site"
PAGES = SITE / "pages"
PROGRAM = pathlib.Path(os.environ.get("PLENOCAL_PROGRAM", ROOT / "build/release/apps/plenocal"))
PICTURES = {".jpg", ".svg"}
LANGUAGES = {".cc": "cpp", ".h": "cpp", ".json": "json", ".ipynb": "json", ".txt": "cmake", ".cff": "yaml", ".yml": "yaml"}
DOCUMENTS = {ROOT / name: page for name, page in {
    "README.md": "readme.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md", "SECURITY.md": "security.md",
    "bench/README.md": "benches.md"}.items()} | {path: path.name for path in sorted((ROOT / "docs").glob("*.md"))}
TITLES = {page: title for title, page in re.findall(r"- (.+): (\w+\.md)$", (ROOT / "docs/site/mkdocs.yml").read_text(), re.MULTILINE)}
PYTHON = ["commands", "calibration", "camera", "images", "model", "session", "space", "target", "program", "errors"]


def write(page: str, text: str) -> None:
    (PAGES / page).parent.mkdir(parents=True, exist_ok=True)
    (PAGES / page).write_text(text)


# ---- Documents: GitHub's Markdown as Python-Markdown reads it.

def with_deep_lists(lines: list[str]) -> list[str]:
    """Items of lists and what belongs to them four columns in, a blank line before the first item and before a table."""
    out: list[str] = []
    inside: list[int] = []  # columns of the text of the open items
    fence = False
    for line in lines:
        indent = len(line) - len(line.lstrip())
        item = None if fence else re.match(r" *([-*]|\d+\.) +", line)
        if line.strip() and not fence:
            was_lazy = inside and not item and out and out[-1].strip() and indent < inside[-1]
            while inside and indent < inside[-1] and not was_lazy:
                inside.pop()
        depth = len(inside)
        text = " " * (4 * depth) + line[inside[-1] if inside and indent >= inside[-1] else indent:] if inside else line
        previous = out[-1].strip() if out else ""
        opens_list = item and not re.match(r"([-*]|\d+\.) ", previous)
        after_code = item and previous == "```"
        opens_table = not fence and line.startswith("|") and not previous.startswith(("|", "#"))
        if previous and ((opens_list and (depth == 0 and not out[-1].startswith(" ") or depth > 0)) or after_code or opens_table):
            out.append("")
        out.append(text if line.strip() else "")
        if item:
            inside.append(len(item[0]))
        if line.lstrip().startswith("```"):
            fence = not fence
    return out


def linked_page(path: pathlib.Path) -> str:
    """The page, or file of the site, for a file of the repository; makes it where it is none of the documents."""
    if path in DOCUMENTS:
        return DOCUMENTS[path]
    name = path.relative_to(ROOT).as_posix()
    if path.suffix in PICTURES:
        shutil.copy(path, PAGES / path.name)
        return path.name
    if path.suffix == ".ipynb":
        write(f"files/{name}.md", notebook(path))
    else:
        language = LANGUAGES.get(path.suffix, "text")
        write(f"files/{name}.md", f"# {name}\n\n```{language}\n{path.read_text().rstrip()}\n```\n")
    return f"files/{name}.md"


def notebook(path: pathlib.Path) -> str:
    cells = json.loads(path.read_text())["cells"]
    texts = ["".join(cell["source"]) for cell in cells]
    return "\n\n".join(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```"
                       for cell, text in zip(cells, texts)) + "\n"


def document(path: pathlib.Path) -> str:
    def link(match: re.Match[str]) -> str:
        target, hash_, anchor = match[2].partition("#")
        if "://" in target or not target:
            return match[0]
        return f"{match[1]}({linked_page((path.parent / target).resolve())}{hash_}{anchor})"

    lines = path.read_text().split("\n")
    fence = False
    for i, line in enumerate(lines):
        fence ^= line.lstrip().startswith("```")
        if not fence:
            lines[i] = re.sub(r"(\])\(([^)\s]+)\)", link, line)
            lines[i] = re.sub(r"(?<=\[)\w+\.md(?=\])", lambda name: TITLES[name[0]].lower() if name[0] in TITLES else name[0], lines[i])
            if line.startswith("|"):  # GitHub wants a backslash also in code
                lines[i] = re.sub(r"`[^`]*`", lambda code: code[0].replace("\\|", "|"), lines[i])
            if line.startswith("#") and "<" in line:  # GitHub's anchor; Python-Markdown's leaves out what looks like a tag
                lines[i] += f" {{ #{re.sub('[^a-z0-9_ -]', '', line.lstrip('# ').lower()).replace(' ', '-')} }}"
    return "\n".join(with_deep_lists(lines))


# ---- Command line: the man pages that `plenocal help --man` writes, in roff.

def escaped(text: str) -> str:
    """Text in which < is no tag; code stays."""
    return re.sub(r"(`[^`]*`)|<", lambda match: match[1] or "&lt;", text)


def plain(text: str) -> str:
    for roff, sign in (("\\-", "-"), ("\\(aq", "'"), ("\\&", ""), ("\\fB", ""), ("\\fI", ""), ("\\fR", ""), ("\\e", "\\")):
        text = text.replace(roff, sign)
    return text


def command_page(roff: str) -> tuple[str, str]:
    """Title and text of the page of one man page."""
    out: list[str] = []
    title, section, fence = "", "", False
    lines = iter(roff.split("\n"))
    for line in lines:
        if line == ".SH SEE ALSO":
            break
        if line.startswith(".TH"):
            title = plain(line.split()[1])
            title = title if title == "plenocal" else title.replace("plenocal-", "plenocal ", 1)
            out += [f"# {title}", ""]
        elif line.startswith((".SH", ".SS")):
            section = plain(line[4:])
            if section not in ("NAME", "DESCRIPTION", "SYNOPSIS"):
                out += ["", f"{'##' if line[2] == 'H' else '###'} {section.capitalize() if section.isupper() else section}", ""]
        elif line == ".TP":
            term = plain(next(lines)).replace(" (required)", "")
            out += ["", f"`{term}`", f":   {escaped(plain(next(lines)))}"]
        elif line == ".nf" or line == ".fi":
            fence = line == ".nf"
            out += ["", "```text" if fence else "```"] + ([] if fence else [""])
        elif line.startswith("."):
            out += [] if fence else [""]
        elif section == "NAME":
            continue
        elif section == "SYNOPSIS":
            synopsis = plain(line)
            if synopsis:
                out += ["```text", synopsis, "```", ""]
        else:
            out.append(plain(line) if fence else escaped(plain(line)))
    return title, "\n".join(out) + "\n"


def command_line() -> list[dict[str, str]]:
    if not PROGRAM.exists():
        sys.exit(f"{PROGRAM} is missing: build it (scripts/test, or cmake --workflow --preset release) or set PLENOCAL_PROGRAM")
    man = SITE / "man"
    subprocess.run([PROGRAM, "help", "--man", man], check=True)
    entries = []
    for path in sorted(man.glob("*.1"), key=lambda path: path.stem):
        title, text = command_page(path.read_text())
        write(f"reference/cli/{path.stem}.md", text)
        entries.append({title: f"reference/cli/{path.stem}.md"})
    return entries


# ---- C++: the headers, folder by folder, from Doxygen's XML.

def words(element: xml.Element | None) -> str:
    """Text of a description; code stays code."""
    if element is None:
        return ""
    text = element.text or ""
    for child in element:
        inner = words(child)
        if child.tag == "computeroutput":
            inner = f"`{inner}`"
        elif child.tag == "listitem":
            inner = f"\n- {inner.strip()}"
        elif child.tag in ("para", "simplesect"):
            inner = f"{inner}\n\n"
        text += inner + (child.tail or "")
    return text


def described(member: xml.Element) -> str:
    both = words(member.find("briefdescription")) + words(member.find("detaileddescription"))
    return escaped(re.sub(r"\n{3,}", "\n\n", both.strip()))


def compact(code: str) -> str:
    """Without Doxygen's blanks in brackets; long lists of arguments with one a line."""
    code = re.sub(r" ([&*])(?=\w)", r"\1 ", re.sub(r"(?<=<) | (?=>)", "", code))
    if len(code) > 88 and (match := re.match(r"(.*?\()(.*)(\).*)$", code, re.DOTALL)) and match[2]:
        arguments, depth = [""], 0
        for sign in match[2]:
            depth += (sign in "<({") - (sign in ">)}")
            if sign == "," and depth == 0:
                arguments.append("")
            else:
                arguments[-1] += sign
        code = match[1] + "\n    " + ",\n    ".join(each.strip() for each in arguments) + match[3]
    return code


def declaration(member: xml.Element) -> str:
    kind, name = member.get("kind"), member.findtext("name")
    template = ", ".join(" ".join(filter(None, (words(p.find("type")), p.findtext("declname")))) for p in member.findall("templateparamlist/param"))
    head = f"template <{template}>\n" if template else ""
    type_ = "static " * (member.get("static") == "yes" and kind == "function") + re.sub(r" ([&*]+)$", r"\1", words(member.find("type")))
    if kind == "enum":
        return f"enum class {name} {{ {', '.join(v.findtext('name') or '' for v in member.findall('enumvalue'))} }};"
    if kind == "typedef":
        return f"{head}using {name} = {type_};"
    value = words(member.find("initializer")) if kind == "variable" else ""
    return compact(f"{head}{type_ + ' ' if type_ else ''}{name}{member.findtext('argsstring') or ''}{value and ' ' + value};")


def fields(members: list[xml.Element]) -> list[str]:
    lines = []
    for member in members:
        note = described(member).replace("\n", " ").replace("`", "").replace("&lt;", "<")
        lines += [f"// {note}"] * bool(note) + [declaration(member)]
    return ["```cpp", *lines, "```", ""] if lines else []


def entry(member: xml.Element) -> list[str]:
    if member.tag == "memberdef":
        values = [f"- `{v.findtext('name')}`: {described(v)}" for v in member.findall("enumvalue") if described(v)]
        return [f"### {member.findtext('name')}", "", "```cpp", declaration(member), "```", "", described(member), "", *values, ""]
    name = (member.findtext("compoundname") or "").split("::")[-1]
    public = [m for m in member.iter("memberdef") if m.get("prot") == "public" and m.get("kind") != "friend"]
    out = [f"### {name}", "", f"*{member.get('kind')}* `{member.findtext('compoundname')}`", "", described(member), ""]
    out += fields([m for m in public if m.get("kind") in ("variable", "typedef", "enum")])
    for function in (m for m in public if m.get("kind") == "function"):
        out += ["```cpp", declaration(function), "```", "", described(function), ""]
    return out


def heading_comment(header: pathlib.Path) -> str:
    lines = header.read_text().split("\n")[1:]
    text = []
    for line in lines:
        if not line.startswith("//"):
            break
        text.append(line.removeprefix("//").strip())
    return escaped("\n".join(text).strip())


def cpp() -> list[object]:
    folder = SITE / "doxygen"
    shutil.rmtree(folder, ignore_errors=True)
    subprocess.run(["doxygen", "-"], check=True, cwd=ROOT, text=True, stderr=subprocess.DEVNULL, input=f"""
INPUT = engine models calib targets
FILE_PATTERNS = *.h
RECURSIVE = YES
GENERATE_HTML = NO
GENERATE_LATEX = NO
GENERATE_XML = YES
OUTPUT_DIRECTORY = {folder}
XML_PROGRAMLISTING = NO
QUIET = YES
EXTRACT_ALL = YES
""")
    found: dict[str, list[tuple[int, list[str]]]] = collections.defaultdict(list)
    for path in sorted((folder / "xml").glob("*.xml")):
        for compound in xml.parse(path).getroot().findall("compounddef"):
            is_class = compound.get("kind") in ("class", "struct") and "<" not in (compound.findtext("compoundname") or "")
            for member in [compound] if is_class else compound.iter("memberdef") if compound.get("kind") == "namespace" else []:
                place = member.find("location")
                if place is not None and member.get("prot", "public") == "public":
                    found[place.get("file", "")].append((int(place.get("line", 0)), entry(member)))
    public = ["engine/api/plenocal/engine.h", "calib/base/run.h", "calib/base/error.h"]
    folders = {"plenocal/engine.h": public}
    for top in ("calib", "engine", "models", "targets"):
        for header in sorted((ROOT / top).rglob("*.h")):
            name = header.relative_to(ROOT).as_posix()
            if name not in public:
                folders.setdefault(os.path.dirname(name), []).append(name)
    entries: list[object] = []
    for title in ["plenocal/engine.h"] + sorted(folders.keys() - {"plenocal/engine.h"}):
        is_public = title == "plenocal/engine.h"
        intro = ("The interface for other programs: one header, installed by `cmake --install` "
                 "([how to use it](../../guide.md#from-a-program))." if is_public else
                 "For developers of Plenocal; may change with any version ([architecture](../../architecture.md)).")
        lines = [] if is_public else ["---", "search: {boost: 0.3}", "---"]
        lines += [f"# {title}", "", intro, ""]
        for header in folders[title]:
            lines += [f"## {header.removeprefix('engine/api/')}", "", heading_comment(ROOT / header), ""]
            lines += [line for _, text in sorted(found[header], key=lambda each: each[0]) for line in text]
        page = f"reference/cpp/{title.replace('/', '_').replace('.', '_')}.md"
        write(page, "\n".join(lines) + "\n")
        entries.append({title: page})
    return [entries[0], {"Headers inside": entries[1:]}]


def python() -> list[dict[str, str]]:
    for source in sorted((ROOT / "python/plenocal").glob("*.py*")):  # examples of docstrings as blocks of code
        text = re.sub(r"^( *)>>> .*\n(?:\1(?!\"\"\").+\n)*", r"\1```pycon\n\g<0>\1```\n", source.read_text(), flags=re.MULTILINE)
        text = re.sub(r"(`[^`\n]*`)|<(?=\w+>)", lambda match: match[1] or "&lt;", text)
        write(f"../python/plenocal/{source.name}", text)
    package = (ROOT / "python/plenocal/__init__.py").read_text()
    exported = set(re.findall(r'^    "(\w+)",$', package, re.MULTILINE))
    names = [""] + PYTHON
    for name in names:
        module = f"plenocal.{name}".rstrip(".")
        source = (ROOT / f"python/plenocal/{name or '__init__'}.py").read_text()
        members = [each for each in re.findall(r"^(?:class|def) (\w+)", source, re.MULTILINE) if each in exported]
        write(f"reference/python/{name or 'plenocal'}.md", f"# {module}\n\n::: {module}\n    options:\n      show_root_toc_entry: false\n      members: {members}\n")
    return [{name or "plenocal": f"reference/python/{name or 'plenocal'}.md"} for name in names]


def main() -> None:
    shutil.rmtree(PAGES, ignore_errors=True)
    PAGES.mkdir(parents=True)
    for path, page in DOCUMENTS.items():
        write(page, ("---\nhide: [navigation, toc]\n---\n" if page == "index.md" else "") + document(path))
    shutil.copy(ROOT / "docs/site/style.css", PAGES)
    nav = {"Command line": command_line(), "Python": python(), "C++": cpp()}
    files = [{path.relative_to(PAGES / "files").as_posix().removesuffix(".md"): path.relative_to(PAGES).as_posix()}
             for path in sorted((PAGES / "files").rglob("*.md"))]
    lines = [f"      - {json.dumps(title)}: {json.dumps(pages)}" for title, pages in (nav | {"Files": files}).items()]
    (SITE / "mkdocs.yml").write_text((ROOT / "docs/site/mkdocs.yml").read_text() + "\n".join(lines) + "\n")


main()
