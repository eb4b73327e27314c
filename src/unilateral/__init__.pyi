from unilateral.api import Problem as Problem
from unilateral.api import Solver as Solver
from unilateral.api import case as case
from unilateral.api import certify as certify
from unilateral.api import load as load
from unilateral.api import mesh as mesh
from unilateral.api import solve as solve
from unilateral.errors import BudgetError as BudgetError
from unilateral.errors import InputError as InputError
from unilateral.errors import SolutionWarning as SolutionWarning
from unilateral.geometry.polygon import Polygon as Polygon
from unilateral.solution import Solution as Solution
from unilateral.solvers.stop import Stop as Stop

__version__: str
