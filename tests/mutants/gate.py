"""Choose the tests of the gate, and leave the others to the slow set: the names in tests/left_over.txt.

make gate-choice                       goes on where it was ended; to begin anew, remove out/random_mutants
make gate-choice MATRIX='--count 0'    the choice only, by what there is

First tests/mutants/random_sample.py makes the map of lines, the CPU time of each test and the kill matrix: which two
tests, or which one alone, kill each of 400 random mutants. Who kills a listed mutant `make mutants` has said.

Every line that the fast tests run, and every mutant that they kill, listed or random, keeps a test. These stay: the
contract suites, what costs next to nothing, and what the map does not know (pages in a browser, other processes, public
data). Of the others those that add most per CPU second, until nothing is missing. The rest goes, the most expensive
first, until the gate is short enough. A test is a function with all its parameters.
"""

from __future__ import annotations

import ast
import heapq
import json
import sys
from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mutants import random_sample
from mutants.line_map import CPU, MAP, LineMap, function_of
from mutants.mutant import HERE, ROOT
from mutants.random_sample import LEFT_OVER, results_of

SEED = 20261204
MOST_S, CHEAP_S = 360.0, 0.02
"""CPU seconds: of the gate's tests, to which three workers add 40 to import and collect; of a test not worth moving."""


@dataclass(frozen=True)
class Costs:
    """CPU seconds of each test without its fixtures, those of each fixture that several take, and who takes it."""

    own: Mapping[str, float]
    fixtures: Mapping[str, float]
    takers: Mapping[str, Collection[str]]

    def saved(self, moved: Collection[str]) -> dict[str, float]:
        """Return what the gate saves by each of these: a fixture only where all go that take it, each its share."""
        saved = {test: self.own[test] for test in moved}
        for fixture, takers in self.takers.items():
            if saved.keys() >= set(takers):
                for test in takers:
                    saved[test] += self.fixtures[fixture] / len(takers)
        return saved


def main() -> None:
    """Go on with the matrix, choose, and write the names."""
    random_sample.main(["--seed", str(SEED), "--count", "400", "--kills", "2", *sys.argv[1:]])
    costs, not_passed = measured(CPU)
    covered = covered_lines(LineMap())
    lines = len(set().union(*covered.values()))
    known = {test for test in covered if test in costs.own and not test.startswith("tests/contract/")} - not_passed
    killers = killing()
    for mutant, tests in killers.items():
        for test in tests:
            covered[test].add(mutant)
    price = costs.saved(costs.own)
    movable = {test for test in known if price[test] >= CHEAP_S}
    left = movable - needed(covered, price, covered.keys() - movable)
    before = sum(price.values()) + costs.fixtures[""]
    moved = most_expensive(costs, left, before - MOST_S)
    left_lines = len(set().union(*(found for test, found in covered.items() if test not in moved)) - killers.keys())
    LEFT_OVER.write_text("".join(f"{test}\n" for test in sorted(moved)), encoding="utf-8")
    after = before - sum(costs.saved(moved).values())
    print(f"{before:.0f} s of CPU before, {after:.0f} s after; {len(moved)} of {len(left)} tests left over are moved")
    sole = sum(len(tests) == 1 for tests in killers.values())
    print(f"{left_lines} of {lines} lines; {len(killers)} mutants, {sole} of them with one test that is known to kill")


def measured(folder: Path) -> tuple[Costs, set[str]]:
    """Return the CPU seconds, and the tests that did not pass, or not with all their parameters."""
    cpu: dict[str, float] = defaultdict(float)
    takers: dict[str, set[str]] = defaultdict(set)
    not_passed: set[str] = set()
    for path in folder.glob("*.json"):
        said = json.loads(path.read_text(encoding="utf-8"))
        for context, seconds in said["cpu"].items():
            cpu[context if context.startswith("fixture ") else function_of(context)] += seconds
        for test, fixtures in said["fixtures"].items():
            for fixture in fixtures:
                takers[fixture].add(function_of(test))
        not_passed |= {function_of(test) for test in said["not passed"]}
    own = {test: seconds for test, seconds in cpu.items() if test and not test.startswith("fixture ")}
    fixtures = {name: seconds for name, seconds in cpu.items() if name not in own}
    return Costs(own, fixtures, {name: takers[name] for name in fixtures if takers[name]}), not_passed


def covered_lines(known: LineMap) -> dict[str, set[object]]:
    """Return the lines that each test runs, without those of a module itself, which whoever imports it first runs."""
    found: dict[str, set[object]] = defaultdict(set)
    for file, line, test in known.lines():
        if line in _in_functions(file):
            found[function_of(test)].add((file, line))
    return found


@cache
def _in_functions(file: str) -> frozenset[int]:
    every = ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8")))
    functions = [node for node in every if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return frozenset(line for node in functions for line in range(node.body[0].lineno, (node.end_lineno or 0) + 1))


def killing() -> dict[str, set[str]]:
    """Return the tests that are known to kill each mutant, but for those with which nothing can be imported."""
    listed = json.loads((HERE / "results.json").read_text(encoding="utf-8"))
    drawn = results_of(MAP.with_name(f"{SEED}.jsonl"))
    found = {id_: {test} for id_, test in listed.items()} | {id_: set(said["killers"]) for id_, said in drawn.items()}
    return {id_: tests for id_, tests in found.items() if tests and all("::" in test for test in tests)}


def needed(covered: Mapping[str, set[object]], price: Mapping[str, float], kept: Collection[str]) -> set[str]:
    """Return the tests that cover what those kept do not, the most per CPU second first."""
    missing = set().union(*covered.values()) - set().union(*(covered[test] for test in kept))
    waiting = [(0.0, test) for test in sorted(covered.keys() - set(kept))]
    found = set()
    while missing:
        _, test = heapq.heappop(waiting)
        rank = (-len(covered[test] & missing) / price[test], test)
        if waiting and rank > waiting[0]:
            heapq.heappush(waiting, rank)
        else:
            found.add(test)
            missing -= covered[test]
    return found


def most_expensive(costs: Costs, left: Collection[str], to_save_s: float) -> set[str]:
    """Return so many of the tests left over, the most expensive first, that the gate saves this time, or all."""
    price = costs.saved(left)
    moved: set[str] = set()
    for test in sorted(left, key=lambda test: (-price[test], test)):
        if sum(costs.saved(moved).values()) >= to_save_s:
            break
        moved.add(test)
    return moved


if __name__ == "__main__":
    main()
