# SPDX-License-Identifier: Apache-2.0
"""Checks that each link, picture and anchor of the built site exists, then lists the versions beside it.

    check.py build/site/html 0.1.0
"""
import html.parser
import json
import pathlib
import sys
import urllib.parse

root, version = pathlib.Path(sys.argv[1]), sys.argv[2]

TAGS = set("""a abbr article aside b body br button code dd details div dl dt em fieldset footer form h1 h2 h3 h4 h5 h6 head header hr html
    i img input label li link main meta nav noscript ol option p path pre script section span strong style sub summary sup svg table tbody
    td th thead title tr ul""".split())


class Page(html.parser.HTMLParser):
    def __init__(self, path: pathlib.Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = {""}
        self.unknown: set[str] = set()
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        if tag not in TAGS:
            self.unknown.add(tag)  # <camera> of a text that was not escaped
        self.links += [link for link in (values.get("href"), values.get("src")) if link]
        self.anchors |= {name for name in (values.get("id"), values.get("name")) if name}


pages = {path.resolve(): Page(path) for path in (root / version).rglob("*.html") if path.name != "404.html"}
dead = [f"{path.relative_to(root.resolve())}: <{tag}> is no text" for path, page in pages.items() for tag in page.unknown]
links = 0
for path, page in pages.items():
    for link in page.links:
        parts = urllib.parse.urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
        links += 1
        if not target.exists() or target in pages and urllib.parse.unquote(parts.fragment) not in pages[target].anchors:
            dead.append(f"{path.relative_to(root.resolve())}: {link}")
if dead or links < 1000:
    sys.exit("dead links:\n" + "\n".join(dead))

versions = sorted((path.name for path in root.iterdir() if (path / "index.html").exists()),
                  key=lambda name: [int(part) for part in name.split(".")], reverse=True)
(root / "versions.json").write_text(json.dumps([{"version": v, "title": v, "aliases": []} for v in versions]))
(root / "index.html").write_text(f'<!doctype html><meta http-equiv="refresh" content="0; url={versions[0]}/index.html">\n')
print(f"{root}/{version}: {len(pages)} pages, {links} links, none dead")
