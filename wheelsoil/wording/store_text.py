"""What is damaged in a fleet's store, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from wheelsoil.fleet import Damage, Manifest
from wheelsoil.wording.grounds_text import VERDICT_WORDS
from wheelsoil.wording.names import plain_name

_WHAT = {
    "manifest": "its manifest cannot be read",
    "missing": "the file is missing",
    "size": "the file is not as long as it was",
    "footer": "the file has no Parquet footer",
    "another table": "the file is of another table",
    "another campaign": "the file is of another campaign",
    "checksum": "the file has another checksum",
    "data": "the file's data cannot be read",
}
_LISTED = 40

PLAIN_SCHEDULER = (
    "warning: {} is not encrypted and asks for no login: whoever reaches the scheduler or a worker runs programs there "
    "as you. Use tls:// (docs/fleet.md), or a network that only your machines reach"
)
OPEN_STORE = "note: anyone on this machine may write into the store {}: `chmod o-w` keeps its rows yours"


def verdict_with_causes(manifest: Manifest) -> str:
    """Return a campaign's verdict in words, with its causes."""
    causes = ", ".join(map(plain_name, manifest.families))
    return ": ".join(filter(None, (VERDICT_WORDS.get(manifest.verdict, manifest.verdict), causes)))


def damage_lines(store: str, damaged: Sequence[Damage]) -> Iterator[str]:
    """Yield what was set aside and why, and how it is made anew."""
    if not damaged:
        return
    names = {damage.campaign for damage in damaged if damage.campaign}
    count = len(names)
    yield f"{count} campaign{'s' * (count != 1)} of the store {'is' if count == 1 else 'are'} damaged and set aside:"
    for damage in damaged[:_LISTED]:
        if damage.campaign:
            yield f"  {damage.campaign}: {_WHAT[damage.what]} ({damage.file})"
        else:
            yield f"  {damage.file} cannot be read; the campaigns were"
    if len(damaged) > _LISTED:
        yield f"  and {len(damaged) - _LISTED} more files"
    yield f"next: `wheelsoil fleet run ROOT --store {store} --check` makes them anew"
