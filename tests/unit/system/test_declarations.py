"""YAML files: what plain scalars mean, and limits that are looked at before anything is built."""

import math
from pathlib import Path

import pytest
import sentences
import yaml

from unilateral.errors import InputError
from unilateral.problems import case, problem_file
from unilateral.system import declarations


@pytest.fixture
def read(tmp_path):
    """What a file with this text holds."""

    def reading(text):
        file = tmp_path / "own.yaml"
        file.write_text(text)
        return declarations.read_declaration(file, "own.yaml")

    return reading


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12", 12),
        ("-3", -3),
        ("0", 0),
        ("true", True),
        ("false", False),
        ("null", None),
        ("~", None),
        ("", None),
        ("1/3", "1/3"),
        ("0.1", "0.1"),
        ("1e3", "1e3"),
        ("1.0e+3", "1.0e+3"),
        ("'12'", "12"),
        *[(text, text) for text in ("010", "0o10", "0x10", "0b1", "1_000", "1:30", "1:30.5", "-010", "00")],
        *[(text, text) for text in ("yes", "no", "on", "off", "y", "n", "Yes", "True", "NULL", "=", "<<")],
        *[(text, text) for text in ("2001-01-01", "2001-12-14t21:59:43.10-05:00", ".inf", ".nan")],
        ("9" * 5000, "9" * 5000),
    ],
)
def test_plain_scalars_are_what_they_look_like(read, text, value):
    """As a value, in a list and as the name of a field, which always is a text."""
    document = read(f"a: {text}\nb: [{text}]\n")
    assert document == {"a": value, "b": [value] if text else []}
    assert type(document["a"]) is type(value)
    if text.isalnum() and len(text) < 1000:
        assert read(f"{text}: 1") == {text: 1}


TAGS = ("int", "float", "bool", "timestamp", "map", "seq", "set", "omap", "binary", "python/name:os")
BOMB = "a0: &a0 [1]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12))
REFUSED = {
    "alias bomb": (BOMB, "'a0' in line 1 is an anchor or alias; write the value itself"),
    "alias": ("a: *b", "'b' in line 1 is an anchor or alias"),
    **{tag: (f"a: 1\nb: !!{tag} wrong", f"'tag:yaml.org,2002:{tag}' in line 2 is a tag;") for tag in TAGS},
    "own tag": ("a: !x 1", "'!x' in line 1 is a tag"),
    "map as a list's tag": ("a: !!map [1]", "is a tag"),
    "depth": ("a: " + "[" * 11, "it has more than 10 nested lists or fields"),
    "nodes": ("a: [" + "1," * 10_001 + "]", "it has more than 10000 values"),
    "fields": ("".join(f"k{i}: 1\n" for i in range(12_000)), "it has more than 10000 values"),
    "bytes": ("#" * 200_001, "own.yaml has more than 200000 bytes"),
    "a list as a name": ("? [1]\n: 2", "the name of the field in line 1 is not a text"),
    "a field twice": ("b: 1\nb: 2", ": 'b' is given twice, again in line 2; give it once"),
    "a long field twice": (f"? {'b' * 1000}\n: 1\n" * 2, f"'{'b' * 57}...' is given twice"),
    "a number twice": ("1: 1\n'1': 2", "'1' is given twice, again in line 2"),
}


@pytest.mark.parametrize(("text", "message"), REFUSED.values(), ids=REFUSED)
def test_declarations_that_do_not_fit_are_refused_with_the_place(read, text, message):
    with pytest.raises(InputError) as refusal:
        read(text)
    assert str(refusal.value).startswith("own.yaml")
    assert message in str(refusal.value)
    assert len(str(refusal.value)) < 200


@pytest.mark.parametrize("kind", ["alias bomb", "depth", "nodes", "fields", "bytes"])
def test_limits_are_looked_at_before_anything_is_built(read, kind, monkeypatch):
    """Control: what is within the limits is built."""
    built = []
    constructors = dict(yaml.SafeLoader.yaml_constructors)
    monkeypatch.setattr(declarations._Loader, "yaml_constructors", constructors, raising=False)
    for name in ("construct_yaml_map", "construct_yaml_seq"):
        build = getattr(yaml.SafeLoader, name)
        kind_of = f"tag:yaml.org,2002:{name[-3:]}"
        declarations._Loader.add_constructor(
            kind_of, lambda loader, node, build=build: built.append(node) or build(loader, node)
        )
    with pytest.raises(InputError):
        read(REFUSED[kind][0])
    assert built == []
    read("a: [1]")
    assert len(built) == 2


def test_what_is_at_the_limits_is_read(read):
    """11 levels, 10 001 values or 200 001 bytes are refused above."""
    assert read("[" * 10 + "]" * 10) == [[[[[[[[[[]]]]]]]]]]
    assert len(read("[" + "1," * 9_999 + "]")) == 9_999
    assert read("1" + "#".rjust(200_000 - 1)) == 1


def test_a_field_s_names_are_compared_in_linear_time(read):
    """By counting comparisons of 4 000 equal-length names: a set needs next to none, all pairs 8 million."""
    count = 0

    class Name(str):
        __hash__ = str.__hash__

        def __eq__(self, value):
            nonlocal count
            count += 1
            return str.__eq__(self, value)

    loader = declarations._Loader("")
    node = yaml.MappingNode("tag:yaml.org,2002:map", [])
    for i in range(4000):
        key = yaml.ScalarNode("tag:yaml.org,2002:str", Name(f"k{i:04}"))
        node.value.append((key, yaml.ScalarNode("tag:yaml.org,2002:int", "1")))
    assert len(loader.construct_mapping(node)) == 4000
    assert count <= 4000 * math.log2(4000)


@pytest.mark.parametrize("load", [case.read_case_declaration, problem_file.is_problem_file])
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("fine.json", "fine.json does not end in .yaml or .yml; rename it"),
        ("fine.YAML", "fine.YAML does not end in .yaml or .yml; rename it"),
        ("folder", "folder is a folder; name a YAML file, or a case"),
        ("folder.yaml", "folder.yaml is a folder"),
        ("missing.yaml", "there is no file missing.yaml"),
        ("a" * 300, f"{'a' * 57}... cannot be read: File name too long"),
        ("a" * 300 + ".yaml", "cannot be read: File name too long"),
    ],
    ids=lambda value: str(value)[:20],
)
def test_what_is_no_yaml_file_is_said(tmp_path, monkeypatch, load, name, message):
    monkeypatch.chdir(tmp_path)
    for file in ("fine.json", "fine.YAML"):
        Path(file).write_text("{}")
    for folder in ("folder", "folder.yaml"):
        Path(folder).mkdir()
    with pytest.raises(InputError) as refusal:
        load(name)
    assert message in str(refusal.value)


def test_a_case_has_precedence_over_a_folder_and_no_path_leads_out_of_the_catalogue(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("natural").mkdir()
    assert case.read_case_declaration("natural")[1] == "natural"
    assert not problem_file.is_problem_file("natural")
    for name in ("", "../examples/shelter", "../manufactured/natural"):
        with sentences.raises(InputError, name):
            case.read_case_declaration(name)


def test_a_schema_is_parsed_once(tmp_path, monkeypatch):
    """The second declaration is refused as it would be at first."""
    schema = tmp_path / "schema.yaml"
    parsed = []
    schema.write_text("{ type: object, properties: { a: { type: integer } } }")
    parse = declarations.read_stored_yaml
    monkeypatch.setattr(declarations, "read_stored_yaml", lambda file: parsed.append(file) or parse(file))
    assert declarations.validate({"a": 1}, schema, "one") == {"a": 1}
    with sentences.raises(InputError):
        declarations.validate({"a": "b"}, schema, "other")
    assert len(parsed) == 1
