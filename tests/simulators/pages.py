"""What tests look at in pages."""

from __future__ import annotations

from models.common.pages.document import PAGE_END, PAGE_POLICY


def without_script(html: str) -> str:
    """A page without the script of its plots and the policy that allows it; both must be there once."""
    policy = f'<meta http-equiv="Content-Security-Policy" content="{PAGE_POLICY}">'
    assert html.count(PAGE_END) == 1
    assert html.count(policy) == 1
    return html.replace(PAGE_END, "").replace(policy, "")
