"""Habits that make code hard to read are rare in src, and comments are frequent: each is counted."""

import ast
import io
import re
import tokenize
from collections import Counter

import pytest
from conftest import ROOT

TEXTS = {
    file.relative_to(ROOT): file.read_text(encoding="utf-8") for file in sorted((ROOT / "src").rglob("*.py"))
}
TREES = {file: ast.parse(text) for file, text in TEXTS.items()}
OTHER_TREES = {
    folder: [ast.parse(file.read_text(encoding="utf-8")) for file in sorted((ROOT / folder).rglob("*.py"))]
    for folder in ("tests", "benchmarks")
}
MAX_LOCAL_NAMES = 15
"""A function with more local names than these is more than one step, or one algorithm without its steps."""
MAX_LINES = 40
"""A function with more lines below its first one, its docstring included, does not fit on a screen."""
LINES = sum(text.count("\n") for text in TEXTS.values())

FUNCTION_WORDS = {
    *("of", "on", "at", "by", "to", "in_", "off", "of_it", "this", "that", "these", "those", "both", "what"),
    *("each", "other", "others", "one", "own", "rest", "here", "whole", "part", "parts", "alone", "bare"),
    *("more", "most", "less", "least", "much", "left", "found", "held", "kept", "given", "known", "told"),
    *("made", "wanted", "moved", "shown", "said", "seen", "taken", "put", "lost"),
}
"""Words that relate other words or say what was done: as a name each tells where a value came from and not
which quantity it is, so that a reader has to look for its definition."""

POINTER = re.compile(r"\(|(That|Those|See|The same|As|Like|Of|What) ")
"""A shape in parentheses, or a word that points to something else."""
PREPOSITION = re.compile(r"_*(of|on|at|by|in|with|without|to|from|for|over|under|beside|within|up)(_|$)")
PARTICIPLE = re.compile(r"(ed|held|kept|made|told|found|given|shown|said|left|cut|met|known|drawn|taken)_*$")
DIRECTIVES = ("noqa", "type:", "pragma", "fmt:", "mypy:", "ruff:", "!")
"""How a comment begins that is for a program."""


def select_nodes(tree, *kinds):
    """All nodes of these kinds below a tree."""
    return [node for node in ast.walk(tree) if isinstance(node, kinds)]


def list_bindings(tree):
    """Line and name of each variable that is assigned and of each parameter."""
    variables = [node for node in select_nodes(tree, ast.Name) if isinstance(node.ctx, ast.Store)]
    parameters = [(node.lineno, node.arg) for node in select_nodes(tree, ast.arg)]
    return [(node.lineno, node.id) for node in variables] + parameters


def find_function_words(tree):
    """Lines of the bindings whose name is a function word or begins with of_."""
    return [line for line, name in list_bindings(tree) if name in FUNCTION_WORDS or name.startswith("of_")]


def list_unpackings(tree):
    """Line, targets and value of each assignment to several names at once."""
    assignments = select_nodes(tree, ast.Assign)
    return [
        (node.lineno, target.elts, node.value)
        for node in assignments
        for target in node.targets
        if isinstance(target, ast.Tuple | ast.List)
    ]


def is_permutation(targets, values):
    """Whether the values are the targets in another order, as in a swap."""
    return Counter(map(ast.unparse, targets)) == Counter(map(ast.unparse, values))


def find_packed_assignments(tree):
    """Lines of `a, b = x, y`, but not of swaps."""
    return [
        line
        for line, targets, value in list_unpackings(tree)
        if isinstance(value, ast.Tuple | ast.List) and not is_permutation(targets, value.elts)
    ]


def find_unpacked_generators(tree):
    """Lines of `a, b = (f(x) for x in ...)`."""
    return [line for line, _, value in list_unpackings(tree) if isinstance(value, ast.GeneratorExp)]


def find_tuple_names(function):
    """Names to which a function assigns a tuple that it writes out."""
    assignments = [node for node in select_nodes(function, ast.Assign) if isinstance(node.value, ast.Tuple)]
    targets = [target for node in assignments for target in node.targets]
    return {target.id for target in targets if isinstance(target, ast.Name)}


def find_splats(tree):
    """Lines of calls with `*name`, where the function has assigned a tuple to that name."""
    lines = set()
    for function in select_nodes(tree, ast.FunctionDef):
        tuple_names = find_tuple_names(function)
        arguments = [argument for call in select_nodes(function, ast.Call) for argument in call.args]
        splats = [argument for argument in arguments if isinstance(argument, ast.Starred)]
        lines |= {node.lineno for node in splats if ast.unparse(node.value) in tuple_names}
    return sorted(lines)


def find_verbless_functions(tree):
    """Lines of functions whose name begins with a preposition or ends with a participle."""
    functions = select_nodes(tree, ast.FunctionDef)
    return [node.lineno for node in functions if PREPOSITION.match(node.name) or PARTICIPLE.search(node.name)]


def find_pointing_docstrings(tree):
    """Lines of functions whose docstring begins with a shape or points elsewhere."""
    functions = select_nodes(tree, ast.FunctionDef)
    return [node.lineno for node in functions if POINTER.match(ast.get_docstring(node) or "")]


def find_undocumented_functions(tree):
    """Lines of public functions without a docstring; an overload is documented where it is implemented."""
    public = [node for node in select_nodes(tree, ast.FunctionDef) if not node.name.startswith("_")]
    return [
        node.lineno
        for node in public
        if ast.get_docstring(node) is None and "overload" not in map(ast.unparse, node.decorator_list)
    ]


def find_crowded_functions(tree):
    """Lines of functions that assign more than MAX_LOCAL_NAMES names; those of inner functions count."""
    return [
        function.lineno
        for function in select_nodes(tree, ast.FunctionDef)
        if len({node.id for node in select_nodes(function, ast.Name) if isinstance(node.ctx, ast.Store)})
        > MAX_LOCAL_NAMES
    ]


def find_long_functions(tree):
    """Lines of functions of more than MAX_LINES lines."""
    functions = select_nodes(tree, ast.FunctionDef)
    return [node.lineno for node in functions if node.end_lineno - node.lineno > MAX_LINES]


def find_comments(text):
    """Lines of the comments that are for a reader."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    comments = [token for token in tokens if token.type == tokenize.COMMENT]
    return [token.start[0] for token in comments if not token.string.lstrip("# ").startswith(DIRECTIVES)]


def list_module_names(tree):
    """Names that a module defines at its top level, without those that Python knows."""
    definitions = [node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    assigned = [target for node in tree.body if isinstance(node, ast.Assign) for target in node.targets]
    annotated = [node.target for node in tree.body if isinstance(node, ast.AnnAssign)]
    variables = [name for target in assigned + annotated for _, name in list_bindings(target)]
    return {name for name in definitions + variables if not name.startswith("__")}


def find_shared_names(trees):
    """Module-level names of two modules or more."""
    modules = Counter(name for tree in trees for name in list_module_names(tree))
    return sorted(name for name, count in modules.items() if count > 1)


def list_places(find):
    """File and line of all that `find` finds in src."""
    return [f"{file}:{line}" for file, tree in TREES.items() for line in find(tree)]


def test_at_most_one_percent_of_names_are_function_words():
    bindings = list_places(list_bindings)
    assert len(bindings) > 10_000
    places = list_places(find_function_words)
    assert len(places) <= 0.01 * len(bindings), places


def test_at_most_three_packed_assignments_are_in_1000_lines():
    places = list_places(find_packed_assignments)
    assert len(places) <= 3 * LINES / 1000, places


def test_no_generator_is_unpacked():
    assert list_places(find_unpacked_generators) == []


def test_no_local_tuple_is_splatted():
    assert list_places(find_splats) == []


def test_at_most_12_of_100_functions_have_no_verb():
    """Per 100 functions of more than five lines, which are fewer than all."""
    functions = [node for tree in TREES.values() for node in select_nodes(tree, ast.FunctionDef)]
    algorithms = [node for node in functions if node.end_lineno - node.lineno >= 5]
    assert len(algorithms) > 1000
    places = list_places(find_verbless_functions)
    assert len(places) <= 0.12 * len(algorithms), places


def test_docstrings_say_themselves_what_is_returned():
    assert list_places(find_pointing_docstrings) == []


def test_public_functions_have_a_docstring():
    assert list_places(find_undocumented_functions) == []


def test_at_least_20_comments_are_in_1000_lines():
    comments = sum(len(find_comments(text)) for text in TEXTS.values())
    assert comments >= 20 * LINES / 1000


def test_at_most_40_names_are_in_two_modules():
    names = find_shared_names(TREES.values())
    assert len(names) <= 40, names


def find_verbless_helpers(tree):
    """Lines of functions without a verb, but of no test, whose name is the property that it states."""
    tests = {node.lineno for node in select_nodes(tree, ast.FunctionDef) if node.name.startswith("test_")}
    return [line for line in find_verbless_functions(tree) if line not in tests]


@pytest.mark.parametrize(
    ("folder", "find", "limit"),
    [
        ("tests", find_function_words, 0),
        ("tests", find_packed_assignments, 0),
        ("tests", find_unpacked_generators, 0),
        ("tests", find_splats, 0),
        ("tests", find_verbless_helpers, 0),
        ("benchmarks", find_function_words, 0),
        ("benchmarks", find_packed_assignments, 0),
        ("benchmarks", find_unpacked_generators, 0),
        ("benchmarks", find_splats, 0),
        ("benchmarks", find_verbless_helpers, 0),
        ("benchmarks", find_crowded_functions, 6),
        ("benchmarks", find_long_functions, 0),
    ],
)
def test_habits_grow_rarer_in_tests_and_benchmarks(folder, find, limit):
    """A ratchet: each limit is the count of the day on which it was last lowered, and none is raised."""
    assert sum(len(find(tree)) for tree in OTHER_TREES[folder]) <= limit


@pytest.mark.parametrize(("find", "limit"), [(find_crowded_functions, 2), (find_long_functions, 14)])
def test_large_functions_grow_rarer(find, limit):
    """A ratchet of src, whose limits are the counts of the day on which they were last lowered."""
    places = list_places(find)
    assert len(places) <= limit, places


@pytest.mark.parametrize(
    ("find", "text", "lines"),
    [
        (find_function_words, "of = 1\nload = 2\nfor of_f in x: ...\ndef f(held): ...", [1, 3, 4]),
        (find_packed_assignments, "a, b = x, y\na, b = b, a\nx, y = points.T\nc = a, b", [1]),
        (find_unpacked_generators, "a, b = (f(x) for x in y)\na = (f(x) for x in y)", [1]),
        (find_splats, "def f():\n    on = a, b\n    g(*on)\n    g(*c)\ndef h(on):\n    g(*on)", [3]),
        (
            find_verbless_functions,
            "def raised(): ...\ndef of_rest(): ...\ndef _on(): ...\ndef raise_load(): ...\ndef total(): ...",
            [1, 2, 3],
        ),
        (
            find_pointing_docstrings,
            'def f():\n    "(n,) values"\ndef g():\n    "That of a mesh."\ndef h():\n    "Values (n,)."',
            [1, 3],
        ),
        (
            find_undocumented_functions,
            'def f(): ...\ndef g():\n    "Values."\n@overload\ndef h(): ...\ndef _k(): ...',
            [1],
        ),
        (
            find_crowded_functions,
            f"def f():\n    {', '.join(f'x{i}' for i in range(MAX_LOCAL_NAMES))} = y\n"
            f"def g():\n    {', '.join(f'x{i}' for i in range(MAX_LOCAL_NAMES + 1))} = y",
            [3],
        ),
        (
            find_long_functions,
            "def f():\n" + MAX_LINES * "    x\n" + "def g():\n" + (MAX_LINES + 1) * "    x\n",
            [MAX_LINES + 2],
        ),
    ],
)
def test_a_habit_is_found(find, text, lines):
    """Control: on these lines, and on no other one."""
    assert find(ast.parse(text)) == lines


def test_comments_for_a_program_are_not_counted():
    """Control."""
    assert find_comments('# (4.12)\nx = 1  # noqa: E741\ny = "# text"  # in metres\n#!a\n') == [1, 3]


def test_a_name_of_two_modules_is_found():
    """Control: functions, classes and constants, but nothing inside of them."""
    first = "A: int = 1\nB = [x for x in y]\ndef f():\n    x = 1\nclass C: ..."
    second = "A, E = 1, 2\nx = 3\ndef f():\n    x = 1\nclass C: ...\nclass D: ...\n__all__ = []"
    assert find_shared_names([ast.parse(first), ast.parse(second)]) == ["A", "C", "f"]
