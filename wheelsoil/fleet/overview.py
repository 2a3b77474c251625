"""The fleet's report: what the campaigns of a store say one by one and together, as a page and as JSON."""

from __future__ import annotations

import json
import os
from base64 import b64encode
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from daq import ALL_WHEELS
from daq.series import draft_of, write_whole
from model.diagnosis.pooling import Passport
from wheelsoil import __version__
from wheelsoil.fleet.holdings import Holdings, read
from wheelsoil.fleet.pooled import (
    TABLES,
    Pooled,
    campaigns_together,
    day_of,
    passports_json,
    pooled_of,
    pooled_values,
)
from wheelsoil.fleet.store import Store
from wheelsoil.fleet.trend_figures import MOST_POINTS, passport_drawing, trend_drawings
from wheelsoil.report import ticks
from wheelsoil.to_json import streamed
from wheelsoil.web.bidi import in_texts, isolated
from wheelsoil.wording.grounds_text import OPEN_AT, verdict_words
from wheelsoil.wording.names import plain_name, upper
from wheelsoil.wording.numbers import number, typeset
from wheelsoil.wording.passport_text import change_lines, named_lines, passport_line, soil_lines
from wheelsoil.workflows.traction import median_interval

SCHEMA = "wheelsoil/fleet-report/1"
REPORT = "report.html"
"""What a single report beside a campaign's runs is called, to be linked."""
_MOST_BARS = 12
_MOST_ROWS = 5_000
"""Campaigns in the page's table and on its map: a browser still sorts them at once."""
_AT_ONCE = 1_000
_MAP, _LEAST_KM = (720, 300), 0.1
_COLOURS = 5
_OF_A_VEHICLE = ["campaign", "content", "kind", "state", "path", "vehicle", "terrain", "start", "runs", "version"]


@dataclass(frozen=True)
class Overview:
    """What the page shows.

    Attributes
    ----------
    campaigns : pandas.DataFrame
        A row each, of several wheels one for each and one for all together: those of the store's tables that the page
        has, with counts of the runs' grades.
    causes : mapping family -> (named, one of several)
        Number of campaigns.
    """

    url: str
    campaigns: pd.DataFrame
    causes: dict[str, tuple[int, int]]
    pooled: Pooled
    made_at: datetime

    def numbers(self) -> dict[str, Any]:
        """Return every number of the page, and the campaigns that are not on it."""
        return dict(json.loads("".join(self._json())))

    def _json(self) -> Iterator[str]:
        values = pooled_values(self.pooled) | {
            "schema": SCHEMA,
            "made_at": self.made_at.isoformat(timespec="seconds"),
            "store": self.url,
            "headline": self.headline,
            "causes": {family: {"named": a, "one_of": b} for family, (a, b) in self.causes.items()},
            "pulls": self.pulls,
        }
        return streamed(values, {"campaigns": self._rows(), "transducers": passports_json(self.pooled)})

    def _rows(self) -> Iterator[dict[str, Any]]:
        rows = self.campaigns if self.campaigns["wheel"].any() else self.campaigns.drop(columns="wheel")
        for start in range(0, len(rows), _AT_ONCE):
            some = rows.iloc[start : start + _AT_ONCE]
            yield from json.loads(some.to_json(orient="records", date_format="iso"))

    @property
    def headline(self) -> str:
        """The most important finding, in a sentence: wrong transducers, else named causes."""
        wrong = [passport for passport in self.pooled.passports if passport.decision != "nothing"]
        if wrong:
            if len(errors := set(map(_channels, wrong))) > 1:
                each = "; ".join(f"{passport.sensor}: {_channels(passport)}" for passport in wrong)
                return f"{len(wrong)} transducers are wrong. {each}."
            serials = " and ".join(passport.sensor for passport in wrong)
            subject = f"Transducers {serials} are" if len(wrong) > 1 else f"Transducer {serials} is"
            return f"{subject} wrong: {errors.pop()}."
        by_campaigns = [error for error in self.pooled.named if error.is_transducers]
        if by_campaigns:
            effects = " and ".join(dict.fromkeys(plain_name(error.effect) for error in by_campaigns))
            count = len({error.campaign for error in by_campaigns})
            return f"{count} of {self.done} campaigns name{'s' * (count == 1)} an error of the transducer: {effects}."
        named = {family: a for family, (a, _) in self.causes.items() if a}
        if named:
            most = max(named.values())
            first = [plain_name(family) for family, count in named.items() if count == most]
            if len(first) > 1:
                tied = f"{', '.join(first[:-1])} and {first[-1]}"
                return f"{upper(tied)} are named equally often: in {most} of {self.done} campaigns each."
            return f"The cause that is named most often is {first[0]}: in {most} of {self.done} campaigns."
        return f"No cause is named in any of {self.done} campaigns."

    @property
    def count(self) -> int:
        """Number of campaigns."""
        return int(self.campaigns["campaign"].nunique())

    @property
    def done(self) -> int:
        """Campaigns that did not fail."""
        return self.count - int(self.campaigns.loc[self.campaigns["state"] == "failed", "campaign"].nunique())

    @property
    def pulls(self) -> list[dict[str, Any]]:
        """Drawbar pull at slip 0.2 of each terrain: median over campaigns, its 95 % interval by order statistics.

        That of a campaign is the mean of its wheels.
        """
        found = []
        by_campaign = self.campaigns.groupby(["terrain", "campaign"])["pull_at_slip_0_2_n"].mean().dropna()
        for terrain, own in by_campaign.groupby(level="terrain"):
            pull = np.sort(own.to_numpy(float))
            low, high = median_interval(pull)
            found.append(
                {
                    "terrain": terrain,
                    "campaigns": len(pull),
                    "median_n": float(np.median(pull)),
                    "interval95_n": [low, high],
                }
            )
        return sorted(found, key=lambda row: -row["median_n"])

    def write(self, path: Path) -> tuple[Path, Path]:
        """Write the page, and its numbers as JSON beside it; return both paths."""
        beside = path.with_suffix(".json")
        write_whole(path, self.html(path.parent))
        with draft_of(beside) as draft, draft.open("w", encoding="utf-8", errors="backslashreplace") as file:
            file.writelines(self._json())
        return path, beside

    def html(self, folder: Path) -> str:
        """Return the page; links to single reports start at a folder."""
        from jinja2 import Environment, PackageLoader, StrictUndefined

        own, web, report = (files(f"wheelsoil.{name}") for name in ("fleet", "web", "report"))
        style = [web / "static" / "tokens.css", report / "page.css", own / "page.css"]
        script = (own / "page.js").read_text(encoding="utf-8")
        environment = Environment(
            loader=PackageLoader("wheelsoil.fleet", "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True
        )
        bars = sorted(self.causes.items(), key=lambda item: (-item[1][0], -item[1][1]))[:_MOST_BARS]
        page = environment.get_template("page.html.j2").render(
            overview=self,
            rows=[_cells(row, folder) for row in self.campaigns.head(_MOST_ROWS).to_dict("records")],
            bars=[(plain_name(family), a, b, (a + b) / max(self.done, 1)) for family, (a, b) in bars],
            passports=[
                (
                    passport,
                    passport_line(passport, *_days(passport)),
                    passport_drawing(passport),
                    trend_drawings(passport),
                )
                for passport in self.pooled.passports
            ],
            named=list(named_lines(self.pooled.named)),
            changes=list(change_lines(self.pooled.changes)),
            soils=list(soil_lines(self.pooled.soils)),
            pulls=self.pulls,
            chart=_map(self.campaigns),
            error=_errors(self.campaigns),
            most_points=MOST_POINTS,
            number=number,
            version=__version__,
            script=script,
            script_hash=f"'sha256-{b64encode(sha256(script.encode()).digest()).decode()}'",
            style="".join(part.read_text(encoding="utf-8") for part in style),
        )
        return isolated(in_texts(page, typeset))


def overview_of(store: Store) -> Overview:
    """Return the overview of a store."""
    found, damaged = read(store, ("runs", *TABLES), _overview)
    return replace(found, pooled=replace(found.pooled, damaged=damaged))


def _overview(holdings: Holdings) -> Overview:
    from pyarrow import dataset

    pooled = pooled_of(holdings)  # first: it takes the most memory while it works
    campaigns = holdings.table("campaigns").to_pandas()
    together = campaigns_together(holdings)
    if together:
        vehicles = campaigns[campaigns["campaign"].isin(together)].drop_duplicates("campaign")
        campaigns = pd.concat([campaigns, vehicles[_OF_A_VEHICLE].assign(wheel=ALL_WHEELS, state="done")])
    key = ["campaign", "wheel"]
    diagnoses = holdings.table(
        "diagnoses", ["wheel", "verdict", "R0_base", "R0_extended", "none_probability"]
    ).to_pandas()
    of_verdicts = (dataset.field("role") == "named") | (
        (dataset.field("role") == "one_of") & (dataset.field("probability") >= OPEN_AT)
    )
    shown = holdings.where("causes", (*key, "at_wheel", "family", "role"), of_verdicts).to_pandas().drop_duplicates()
    shown["name"] = [
        plain_name(family) + (f" of wheel {at}" if wheel == ALL_WHEELS and isinstance(at, str) else "")
        for wheel, at, family in zip(shown["wheel"], shown["at_wheel"], shown["family"], strict=True)
    ]
    names = shown.groupby(key)["name"].agg(", ".join).rename("cause")
    grades = (
        holdings.table("runs", ["wheel", "grade"]).to_pandas().groupby([*key, "grade"]).size().unstack(fill_value=0)
    )
    grades = grades.reindex(columns=["good", "fair", "poor"], fill_value=0)
    whole = campaigns.merge(diagnoses, on=key, how="left").join(names, on=key).join(grades, on=key)
    # Failed or silent, unexplained, named, one of several, then the others; each by the largest error.
    failed = whole["state"] != "done"
    order = whole["verdict"].map({"unexplained": 1, "named": 2, "one_of": 3}).fillna(4).mask(failed, 0)
    error = whole["R0_base"].astype(float).fillna(0.0).mask(failed, 0.0)
    whole = whole.iloc[np.lexsort((-error.to_numpy(), order.to_numpy()))]
    shown = _counted(shown).drop_duplicates(["campaign", "family", "role"])
    counts = Counter(zip(shown["family"], shown["role"], strict=True))
    families = dict.fromkeys(shown["family"])
    return Overview(
        url=holdings.store.url,
        campaigns=whole.drop(columns=["content"]),
        causes={family: (counts[family, "named"], counts[family, "one_of"]) for family in families},
        pooled=pooled,
        made_at=datetime.now(UTC),
    )


def _counted(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the rows that count: where all wheels of a campaign are diagnosed together, those of all."""
    of_all = rows["wheel"] == ALL_WHEELS
    return rows[of_all | ~rows["campaign"].isin(rows.loc[of_all, "campaign"])]


def _errors(campaigns: pd.DataFrame) -> tuple[float, float] | None:
    """Return the median error on held-out runs before and after, N, of campaigns that have one."""
    errors = ["R0_base", "R0_extended"]
    known = _counted(campaigns.dropna(subset=errors)).groupby("campaign")[errors].mean()
    return (float(known["R0_base"].median()), float(known["R0_extended"].median())) if len(known) else None


def _cells(row: Mapping[Any, Any], folder: Path) -> dict[str, Any]:
    """Return what the table shows of a campaign."""
    of_campaign = Path(row["path"]) / REPORT
    of_wheel = of_campaign.with_stem(f"{of_campaign.stem}-{row['wheel']}")
    report = of_wheel if row["wheel"] and of_wheel.is_file() else of_campaign
    verdict = str(row["verdict"]) if row["verdict"] == row["verdict"] and row["verdict"] else ""
    known = {name: "" if value is None or value != value else value for name, value in row.items()}
    grades = [(level, int(known[level])) for level in ("good", "fair", "poor") if known[level]]
    return {
        "name": row["campaign"],
        "wheel": "all wheels" if known["wheel"] == ALL_WHEELS else known["wheel"] and f"wheel {known['wheel']}",
        "link": os.path.relpath(report, folder.absolute()) if report.is_file() else "",
        "date": f"{row['start']:%Y-%m-%d}" if not pd.isna(row["start"]) else "",
        "terrain": known["terrain"],
        "transducer": known["transducer"],
        "failed": row["state"] == "failed",
        "silent": row["state"] == "silent",
        "verdict": known["fault"] or verdict_words(verdict, {"none": row["none_probability"]}),
        "cause": known["cause"],
        "base": known["R0_base"],
        "extended": known["R0_extended"],
        "pull": known["pull_at_slip_0_2_n"],
        "low": known["pull_at_slip_0_2_lower95_n"],
        "high": known["pull_at_slip_0_2_upper95_n"],
        "grades": ", ".join(f"{count} {level}" for level, count in grades),
        "poor": bool(known["poor"]),
    }


def _channels(passport: Passport) -> str:
    """Return what is wrong with a transducer; those that are not separable with "or"."""
    names = [plain_name(effect) for effect in passport.effects]
    return " and ".join(names) if passport.decision == "named" else f"{' or '.join(names)} (not separable)"


def _days(passport: Passport) -> tuple[str, str]:
    """Return the first and the last day of a transducer's trends; "" without any."""
    years = [point.years for trend in passport.trends.values() for point in trend.points]
    return (day_of(min(years)), day_of(max(years))) if years else ("", "")


def _map(campaigns: pd.DataFrame) -> dict[str, Any] | None:
    """Return the places of campaigns in pixels, by fifths of the pull at slip 0.2; None where no place is known."""
    columns = ["latitude_deg", "longitude_deg", "pull_at_slip_0_2_n"]
    known = campaigns.dropna(subset=columns).groupby("campaign", sort=False)[columns].mean().reset_index()
    known = known.head(_MOST_ROWS)
    if known.empty:
        return None
    east = known["longitude_deg"].to_numpy(float) * np.cos(np.radians(known["latitude_deg"].mean())) * 111.32
    north = known["latitude_deg"].to_numpy(float) * 110.57
    pull = known["pull_at_slip_0_2_n"].to_numpy(float)
    span = max(float(np.ptp(east)) / _MAP[0], float(np.ptp(north)) / _MAP[1], _LEAST_KM / _MAP[0]) * 1.15
    x = _MAP[0] / 2 + (east - (east.max() + east.min()) / 2) / span
    y = _MAP[1] / 2 - (north - (north.max() + north.min()) / 2) / span
    edges = np.quantile(pull, np.linspace(0, 1, _COLOURS + 1)[1:-1])
    fifth = np.searchsorted(edges, pull) + 1
    places = zip(x.round(1), y.round(1), fifth.tolist(), known["campaign"], pull.round(0), strict=True)
    across = span * _MAP[0]
    length = ticks(0.0, across, 5)[1]
    scale = (round(length / span, 1), f"{length:g} km" if length >= 1 else f"{1000 * length:g} m")
    return {"size": _MAP, "places": list(places), "scale": scale, "pulls": (float(pull.min()), float(pull.max()))}
