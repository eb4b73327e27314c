"""The browser itself: what it reports of pages that are written for this test."""

import chromium
import pytest

FINE = "<!doctype html><meta charset=utf-8><title>Fine</title><p class=one style='height: 30px'>λ"
SPOILT = "<img src='https://example.invalid/picture.png'><script>console.error('spoilt'); nothing()</script>"
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def page_of(tmp_path):
    def written(text):
        file = tmp_path / "page.html"
        file.write_text(text, encoding="utf-8")
        return file

    return written


def test_a_fine_page_has_no_errors_and_asks_for_itself_only(browser, page_of):
    file = page_of(FINE)
    page = browser.open(file)
    assert (page.title, page.errors, page.requested, page.elsewhere) == ("Fine", [], [file.as_uri()], [])
    assert browser.heights("p.one") == [30]
    assert browser.heights("p.two") == []
    assert browser.overflow() == 0


def test_errors_requests_and_widths_are_seen(browser, page_of):
    """Control: an error that the script prints, one that ends it, a picture from elsewhere, a wide page."""
    page = browser.open(page_of(FINE + SPOILT + "<div style='width: 900px'>wide</div>"), (400, 400))
    assert [word in "".join(page.errors) for word in ("spoilt", "nothing is not defined")] == [True, True]
    assert page.elsewhere == ["https://example.invalid/picture.png"]
    assert browser.overflow() >= 500
    assert browser.open(page_of(FINE)).errors == []


def test_a_screenshot_is_a_picture_of_the_window(browser, page_of, tmp_path):
    browser.open(page_of(FINE), (640, 480))
    browser.screenshot(tmp_path / "page.png")
    assert (tmp_path / "page.png").read_bytes().startswith(PNG)


def test_where_chromium_is_absent_it_is_said_why(monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert chromium.missing() == "not in PATH: chromium, chromedriver (Debian: chromium and chromium-driver)"
