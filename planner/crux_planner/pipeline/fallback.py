"""What `auto` changes where it finds no plan, and what it proves: first where that is quick, and last where it needs a
search.
"""

from dataclasses import replace

from crux_planner.certificates.infeasibility.infeasible import Proof
from crux_planner.errors import FOR_ALL_REACH, HorizonError, InfeasibleError
from crux_planner.physics.reachable_set import ReachableSet
from crux_planner.pipeline.solve_and_check import Climb

ATTEMPTS = 8
GOAL_PROOF, FIRST_PROOF, LAST_PROOF = 300, 250, 3000  # programs for the goal's equilibrium, and for disconnected parts


def farther(climb: Climb) -> Climb:
    """The same with all of the limbs' inner reach."""
    problem = climb.problem.farther()
    return replace(climb, oracles=replace(climb.oracles, problem=problem, reachable=ReachableSet(problem)))


def disproved(climb: Climb, none_near: InfeasibleError | None, held: bool = False) -> Proof | None:
    """What can be shown about the climb, where nothing quick shows that it has no plan; else raises InfeasibleError.
    That start and goal are connected is asked where something else found no plan. `held`: a body at the goal holds on
    in balance, by the map. None where faces lean or cuboids are turned, and of limbs without closed-form kinematics:
    nothing is shown of these.
    """
    if not climb.problem.upright or not climb.problem.closed_form:
        return None
    proof = Proof(climb.session.scenario, climb.session.robot, climb.problem)
    with climb.work.part("proof", 0.1):
        impossible = proof.quick(held, climb.session.deadline)
        if impossible is None and not held:
            impossible = proof.goal_equilibrium(GOAL_PROOF, climb.session.deadline)
        if impossible is not None:
            raise impossible
        impossible = None if none_near is None else proof.disconnected(FIRST_PROOF, climb.session.deadline)
    if none_near is not None and impossible is not None:
        raise _explained(proof.instead_of(none_near), impossible)
    return proof


def at_last(climb: Climb, none_level: InfeasibleError, proof: Proof | None) -> InfeasibleError:
    """What to say where nothing finds a plan: what stops a level body, and whether that is proven. `proof` is what is
    shown already; None where the map has a body at the goal that holds on, or nothing is shown (see `disproved`).
    """
    proof = proof or disproved(climb, None, held=True)
    if proof is None:
        return none_level
    none_level = proof.instead_of(none_level)
    if isinstance(none_level, HorizonError):
        return none_level
    with climb.work.part("proof", 0.9):
        impossible = proof.disconnected(LAST_PROOF, climb.session.deadline)
    return none_level if impossible is None else _explained(none_level, impossible)


def _explained(none_level: InfeasibleError, impossible: InfeasibleError) -> InfeasibleError:
    """What stops a level body names the place best; the proof is about all others too."""
    return InfeasibleError(none_level.constraint, f"{none_level} (proven {FOR_ALL_REACH}: {impossible})", proven=True)


def without_blamed(climb: Climb, failure: InfeasibleError) -> Climb | None:
    """A remedy: the move that is to blame goes another way from now on, or none."""
    if failure.blamed is None:
        return None
    climb.oracles.swings.forbid(*failure.blamed)
    return climb
