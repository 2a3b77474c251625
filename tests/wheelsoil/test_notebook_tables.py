"""HTML tables of a notebook: texts stay texts, and names that turn the direction of writing are isolated."""

import unicodedata
from html.parser import HTMLParser

from hypothesis import example, given
from hypothesis import strategies as st

from wheelsoil.notebook import html_paragraph, html_table

TURNING = st.text(st.sampled_from("a1 <&\n\u05d0\u0628\u202e"), min_size=1, max_size=20)


class Texts(HTMLParser):
    """Collects tags and texts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.all: list[str] = []
        self.texts: list[str] = []
        self.isolated: list[str] = []
        self.open: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        (self.isolated if "bdi" in self.open else self.texts).append(data)
        self.all.append(data)


def turns(text):
    """Whether a text holds a letter that is written from right to left."""
    return any(unicodedata.bidirectional(letter) in ("R", "AL") for letter in text if letter <= "\uffff")


@given(st.lists(st.text(min_size=1, max_size=20) | TURNING, min_size=2, max_size=2))
@example(["wheel \u05d0\u05d1 left", "\u0628<b>"])
def test_names_are_data_and_never_markup(row):
    page = Texts(html_table(row, [row], caption=row[0]) + html_paragraph(row[1]))
    assert set(page.tags) - {"bdi"} == {"table", "caption", "thead", "tr", "th", "tbody", "td", "p"}
    expected = "".join([row[0], *row, *row, row[1]])
    assert "".join(page.all).replace("\r", "\n") == expected.replace("\r", "\n")
    assert not any(map(turns, page.texts))
    assert len(page.isolated) >= 3 * sum(map(turns, row))
    assert "bdi" not in page.tags or max(map(max, row)) >= "\u0590"


def test_an_empty_text_is_no_paragraph():
    assert html_paragraph("") == ""
