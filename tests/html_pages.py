"""Reports for the tests of the page, and a reader that lets nothing through that is not well formed."""

from html.parser import HTMLParser

import calibrate

QUICK = ("--methods", "raw,least_squares", "--no-explain", "--quiet")
WHOLE = ("--methods", "raw,raw_bias_removed,least_squares", "--quiet")
VOID = {"meta", "link", "br", "img"}


def report_of(folder, out, *arguments):
    assert calibrate.main(["report", str(folder), "--out", str(out), *arguments]) in (0, 1)
    return out


class Strict(HTMLParser):
    """Every element is closed in its order; ids are unique; nothing runs, nothing is fetched."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.tags, self.words = [], [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        for name, value in attributes:
            assert not name.startswith("on"), (tag, name)
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href"):
                assert value.startswith(("#", "data:")), (tag, value)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def parsed(text):
    parser = Strict()
    parser.feed(text)
    parser.close()
    assert parser.open == []
    assert len(parser.ids) == len(set(parser.ids))
    return parser
