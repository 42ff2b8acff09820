"""Checks of the pages that the product writes."""

import re
from html.parser import HTMLParser

VOID = {"meta", "link", "br", "hr", "img", "input"}


class Page(HTMLParser):
    """Checks that every element is closed in its order, and collects what a browser would load."""

    def __init__(self, text):
        super().__init__()
        self.open, self.loads, self.links, self.words = [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        values = dict(attrs)
        self.loads += [values["src"]] if "src" in values else []
        if tag in ("link", "image", "use"):
            self.loads += [values[key] for key in ("href", "xlink:href") if key in values]
        elif tag == "a":
            self.links.append(values.get("href", values.get("xlink:href")))

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def check_self_contained(html):
    page = Page(html)
    assert all(load.startswith(("#", "data:")) for load in page.loads), page.loads
    assert not re.search(r"url\((?!['\"]?#)|@import|<iframe|fetch\(|XMLHttpRequest|import\(", html)
    # namespaces are names, not addresses
    assert set(re.findall(r"https?://[^\s\"'<>)]+", html)) <= {
        "http://www.w3.org/2000/svg",
        "http://www.w3.org/1999/xlink",
    }
    assert len(html) < 5 << 20
    return page
