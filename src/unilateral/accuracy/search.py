"""A stated accuracy, certified: the levels up to it, and what ends them.

The first level whose guaranteed total bound is small enough is the last. The search also ends where finer
meshes would not help, because too little is known of f or g, and where two levels' bounds contradict each
other, which would be a fault of this program. A limit, or an interrupt, gives up the level in hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

from unilateral.accuracy.goal import Goal
from unilateral.accuracy.level import Level, Prospect, Summary, standing, unknowable, without_contact
from unilateral.accuracy.levels import levels, limits, wanted
from unilateral.accuracy.plan import Plan, enough, hopeless, plan, reach
from unilateral.accuracy.watch import OutOfBudget, Watch
from unilateral.discrete.solution import DiscreteSolution
from unilateral.errors import BudgetError, InputError
from unilateral.problems.scaled import Data
from unilateral.solvers.stop import Stop

INTERRUPTED = "interrupted"
CONTRADICTED = "bounds contradict each other"
WITHDRAWN = "withdrawn, because they contradict each other; please report it"
NOT_CONVERGED = "the iteration did not converge (max_steps=, rho=, algorithm=)"
OUT_OF_REACH = "out of reach"
WITHOUT_CONTACT = "lambda_H is 0, so a relative error has no meaning; ask for an absolute accuracy"
REFUSED = "the next level is refused"
NOT_ENCLOSED = "f or g varies too fast or has terms that cancel"
STOPS = (KeyboardInterrupt, OutOfBudget, MemoryError, InputError)
"""These end a search; finished levels are kept."""


@dataclass(frozen=True, eq=False)
class Search:
    """The finished levels, and what `ended` the search; that is empty if the accuracy was reached.

    `plan` predicts what the accuracy takes if a limit ended the search and that can be told; `reach` is
    a larger accuracy that the limits allow, where the plan shows that they do not allow this one. Copies and
    files keep the best level alone, and what is `told` of all.
    """

    done: list[Level]
    ended: str
    refusal: InputError | None = None
    plan: Plan | None = None
    reach: float | None = None
    told: tuple[Summary, ...] = ()

    def __repr__(self) -> str:
        outcome = "certified" if self.certified else f"not certified: {self.ended}"
        return f"Search: {len(self.summaries)} levels, {outcome}"

    @property
    def summaries(self) -> tuple[Summary, ...]:
        """What is told of all levels."""
        return self.told or tuple(level.summary for level in self.done)

    def kept(self, solved: DiscreteSolution) -> Search:
        """The search without its levels but the best one, of which `solved` is the solution."""
        return replace(self, done=[replace(self.best, solved=solved)], told=self.summaries)

    @cached_property
    def believed(self) -> list[Level]:
        """The levels that no other one contradicts."""
        return standing(self.done)

    @cached_property
    def best(self) -> Level:
        """The last believed level that is certified, or else the one with the smallest bound.

        If no level is believed, it is the finest one.
        """
        candidates = reversed(self.believed or self.done[-1:])
        return min(candidates, key=lambda level: (not level.certified, level.total))

    @property
    def certified(self) -> bool:
        return bool(self.believed) and self.best.certified


def search(
    problem: Data,
    goal: Goal,
    stop: Stop | None = None,
    kind: str = "",
    tell: Callable[[Level], None] | None = None,
    watch: Watch | None = None,
    probe: bool = False,
) -> Search:
    """Solves all `levels` and calls `tell` with each; an interrupt or a limit keeps those that are done.

    If the goal has no limit of its own, the process takes no more memory than is free at the beginning, and
    the search ends as soon as the plan shows that this or the seconds do not suffice by far. To `probe`, it
    ends when the levels are enough for a plan. Before the first one is done, what stops the search is raised:
    KeyboardInterrupt, InputError, and BudgetError for a limit.
    """
    stop, watch, done = stop or Stop(), watch or Watch(), list[Level]()
    far = False
    stopped: BaseException | None = None
    prospect: Prospect | None = None
    try:
        for level in levels(problem, goal, stop, kind, watch):
            done.append(level)
            prospect = Prospect(tuple(done), stop, kind, watch.elapsed)
            if tell:
                tell(level)
            far = hopeless(prospect)
            if far or (probe and enough(prospect)):
                break
        watch.rest()
    except BaseException as caught:
        stopped = watch.raised or caught  # of which some libraries make another error
        if not isinstance(stopped, STOPS):
            raise
        watch.rest()
    if prospect is None:
        raise _without_result(problem, stopped)
    return _ended(prospect, stopped, probe, far)


def _ended(prospect: Prospect, stopped: BaseException | None, probe: bool, far: bool) -> Search:
    done, last = list(prospect.done), prospect.done[-1]
    if isinstance(stopped, KeyboardInterrupt):
        return Search(done, INTERRUPTED)
    if isinstance(stopped, InputError):
        return Search(done, REFUSED, stopped)
    if len(standing(done)) < len(done):
        return Search(done, CONTRADICTED)
    if without_contact(last) and not last.certified:
        return Search(done, WITHOUT_CONTACT)
    if not (last.certified or last.solved.result.converged):
        return Search(done, NOT_CONVERGED)
    if unknowable(last) and not last.certified:
        return Search(done, NOT_ENCLOSED)
    if probe or far:
        planned = plan(prospect)
        missed = planned.missed if planned else ()
        of_limits = f" ({', '.join(missed)})" if missed else ""
        ended = "" if probe else f"{OUT_OF_REACH}{of_limits}"
        return Search(done, ended, plan=planned, reach=reach(prospect) if missed else None)
    if stopped or wanted(done):
        reached = _limit(stopped) if stopped else ", ".join(limits(prospect))
        return Search(done, f"out of budget ({reached})", plan=plan(prospect))
    return Search(done, "")


def _limit(stopped: BaseException) -> str:
    return "the memory of this machine" if isinstance(stopped, MemoryError) else str(stopped)


def _without_result(problem: Data, stopped: BaseException | None) -> BaseException:
    if isinstance(stopped, OutOfBudget):
        name = problem.polygon.name
        return BudgetError(f"{stopped} is not enough to solve on the coarsest mesh of '{name}'")
    assert stopped is not None
    return stopped
