"""HTML tables of a notebook: texts stay texts."""

from html.parser import HTMLParser

from hypothesis import given
from hypothesis import strategies as st

from wheelsoil.notebook import html_paragraph, html_table


class Texts(HTMLParser):
    """Collects tags and texts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.texts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)

    def handle_data(self, data):
        self.texts.append(data)


@given(st.lists(st.text(min_size=1, max_size=20), min_size=2, max_size=2))
def test_names_are_data_and_never_markup(row):
    page = Texts(html_table(row, [row], caption=row[0]) + html_paragraph(row[1]))
    assert set(page.tags) == {"table", "caption", "thead", "tr", "th", "tbody", "td", "p"}
    expected = "".join([row[0], *row, *row, row[1]])
    assert "".join(page.texts).replace("\r", "\n") == expected.replace("\r", "\n")


def test_an_empty_text_is_no_paragraph():
    assert html_paragraph("") == ""
