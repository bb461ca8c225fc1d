import json
import string

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swim2real.advisor.vlm.reply import ReplyError, parse_reply, reply_schema
from swim2real.parameters import Parameter, ParameterSpace
from swim2real.robots.fish import FISH

SPACE = ParameterSpace(
    (
        Parameter("drag", "-", 0.0, 10.0, "slows it", 1.0, log_offset=0.1),
        Parameter("arm", "m", 0.01, 0.06, "bends it", 0.04),
        Parameter("spring", "N·m/rad", 0.1, 5.0, "straightens it", 0.6),
    )
)
NOW = {"drag": 2.0, "arm": 0.03, "spring": 1.0}


def reply(**parameters) -> str:
    return json.dumps({"diagnosis": "too slow", "reasoning": "drag", "parameters": parameters})


def refusal(text: str) -> str:
    with pytest.raises(ReplyError) as caught:
        parse_reply(text, SPACE, NOW)
    return str(caught.value)


def test_a_reply_is_taken_as_it_is_and_what_it_lacks_is_noted():
    parsed = parse_reply(reply(drag=1.5, arm=0.04, spring=2), SPACE, NOW)
    assert parsed.values == {"drag": 1.5, "arm": 0.04, "spring": 2.0}
    assert (parsed.diagnosis, parsed.reasoning, parsed.notes()) == ("too slow", "drag", {})
    parsed = parse_reply(reply(drag=99, gravity=3, arm=None), SPACE, NOW)
    assert parsed.values == {"drag": 10.0, "arm": 0.03, "spring": 1.0}
    assert parsed.notes() == {"ignored": ["gravity"], "missing": ["arm", "spring"], "clipped": {"drag": 99.0}}


@pytest.mark.parametrize("around", [
    "```json\n@\n```",
    "Here is what I think {it} sees:\n\n@\n\nGood luck!",
    'First try: {"parameters": 3} no, better:\n@',
    "<think>{{{{{{{{</think>@", "\ufeff@",
])  # fmt: skip
def test_json_is_found_in_what_stands_around_it(around):
    assert parse_reply(around.replace("@", reply(drag=1.5)), SPACE, NOW).values["drag"] == 1.5


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the reply is empty; answer with one"),
        ('{"diagnosis": "x", "parameters": {"drag": 1.5', "the reply is not valid JSON: Expecting ',' delim"),
        ('{"parameters": [1, 2]}', "'parameters' is [1, 2]; it must be a table of names and values"),
        ('{"diagnosis": 3, "parameters": {"drag": 1.5}}', "'diagnosis' is 3; it must be a text"),
        ('{"parameters": {"drag": NaN, "arm": "thin"}}', "; 'arm' is \"thin\"; it must be"),  # all at once
        ('{"parameters": {"drag": 1e999}}', "'drag' is Infinity; it must be a finite"),
        ('{"parameters": {"drag": true}}', "'drag' is true; it must be a finite number"),
        ('{"parameters": {"drag": 1, "drag": 2}}', "the reply is not valid JSON: 'drag' stands there twice"),
        ('{"parameters": {}}', "no parameter of the simulator has a value: 'parameters' is empty"),
        ('{"parameters": {"drga": 1}}', "unknown parameter 'drga'; did you mean 'drag'?"),
        (reply(drag=2.0004, arm=0.03), "no parameter changes"),
        ('{"parameters": {"drag": ' + "9" * 400 + "}}", "it must be a finite number"),
        ('{"parameters": {"drag": ' + "9" * 5000 + "}}", "the reply is not valid JSON"),
        ('{"a":' * 100_000, "the reply is not valid JSON: it is nested too deep"),
    ],
)  # fmt: skip
def test_what_can_not_be_used_is_named(text, said):
    assert said in refusal(text)


def test_words_may_come_as_a_list_and_can_always_be_written_to_a_file():
    text = '{"diagnosis": ["too slow", "too wide"], "reasoning": "\\ud800 \\u0000drag", "parameters": {"drag": 1}}'
    parsed = parse_reply(text, SPACE, NOW)
    assert parsed.diagnosis == "too slow\ntoo wide"
    assert parsed.reasoning == "? drag"
    long = parse_reply(reply(drag=1).replace("too slow", "x" * 50_000), SPACE, NOW)
    assert len(long.diagnosis) == 20_000


def test_parameters_that_keep_their_value_stay_at_the_incumbents_coordinates_to_the_last_bit():
    incumbent = np.random.default_rng(0).random(3)
    current = SPACE.to_values(incumbent)
    shown = {name: float(f"{value:.4g}") for name, value in current.items()}
    parsed = parse_reply(reply(**{**shown, "drag": shown["drag"] * 1.5}), SPACE, current)
    point = parsed.point(SPACE, incumbent)
    assert np.array_equal(point[1:], incumbent[1:])
    assert SPACE.to_values(point)["drag"] == pytest.approx(1.5 * shown["drag"])


def test_the_schema_asks_for_every_parameter_in_order_and_says_bounds_only_when_asked():
    schema = reply_schema(FISH.space)
    assert list(schema["properties"]) == schema["required"]
    assert schema["required"] == [
        "diagnosis",
        "reasoning",
        "parameters",
        "take",
        "probe",
        "measure",
        "keep",
        "predict",
        "solve",
        "weigh",
        "radius",
        "effects",
    ]
    assert schema["properties"]["parameters"]["required"] == list(FISH.space.names)
    assert "minimum" not in json.dumps(schema)
    bounded = reply_schema(FISH.space, bounds=True)["properties"]["parameters"]["properties"]
    assert bounded["motor_arm_length"] == {"type": "number", "description": "m", "minimum": 0.01, "maximum": 0.06}


def test_step_sizes_and_alternatives_are_read_and_asked_for_where_they_are_tried():
    assert "step_sizes" not in json.dumps(reply_schema(FISH.space))
    schema = reply_schema(FISH.space, several=True)["properties"]
    assert list(schema["alternatives"]["items"]["properties"]) == ["reasoning", "parameters", "step_sizes"]
    other = {"reasoning": "or so", "parameters": {"arm": 0.5, "lift": 1}, "step_sizes": [1]}
    answer = {"diagnosis": "slow", "parameters": {"drag": 3.0}, "step_sizes": [0.5, 1.0], "alternatives": [other]}
    proposal = parse_reply(json.dumps(answer), SPACE, NOW).proposal(SPACE, SPACE.to_cube(NOW), {"a": 1})
    assert (proposal.step_sizes, proposal.notes, proposal.diagnosis) == ((0.5, 1.0), {"a": 1}, "slow")
    (alternative,) = proposal.alternatives
    assert (alternative.reasoning, alternative.step_sizes) == ("or so", (1.0,))
    assert alternative.notes == {"ignored": ["lift"], "missing": ["drag", "spring"], "clipped": {"arm": 0.5}}
    for wrong, said in (({"step_sizes": [0]}, "step_sizes"), ({"alternatives": [{"parameters": {}}]}, "no parameter")):
        with pytest.raises(ReplyError, match=said):
            parse_reply(json.dumps({**answer, **wrong}), SPACE, NOW)


@pytest.mark.parametrize(("names", "said"), [(["drog"], "no parameter of the simulator"), ([3], "measure")])
def test_a_list_to_measure_names_parameters(names, said):
    with pytest.raises(ReplyError, match=said):
        parse_reply(json.dumps({"measure": names}), SPACE, NOW)
    assert parse_reply('{"measure": ["arm", "arm"]}', SPACE, NOW).measure == {"arm": None}


names = st.sampled_from(["drag", "arm", "parameters", "x"]) | st.text()
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(names, inner),
)


def usable_or_refused(text: str) -> None:
    """Either values within bounds that differ from the current ones, or a sentence; never another error."""
    try:
        parsed = parse_reply(text, SPACE, NOW)
    except ReplyError:
        return
    SPACE.check(parsed.values)
    assert parsed.values != NOW
    json.dumps([parsed.notes(), parsed.diagnosis, parsed.reasoning], allow_nan=False).encode()
    parsed.diagnosis.encode()
    point = parsed.point(SPACE, SPACE.to_cube(NOW))
    assert np.all((point >= 0) & (point <= 1))


contents = st.fixed_dictionaries(
    {"parameters": st.dictionaries(st.sampled_from([*SPACE.names, "other"]), json_values)},
    optional={"diagnosis": json_values, "reasoning": json_values, "probe": json_values},
)


@pytest.mark.slow
@settings(max_examples=80)
@given(st.text() | json_values.map(json.dumps) | contents.map(json.dumps))
def test_anything_is_usable_or_refused(text):
    usable_or_refused(text)


@settings(max_examples=60)
@given(st.data())
def test_a_good_reply_that_was_damaged_is_usable_or_refused(data):
    text = reply(drag=1.5, arm=0.04, spring=2)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text)))
        cut = data.draw(st.integers(0, 12))
        put = data.draw(st.text(alphabet=string.printable + "é\u2028", max_size=4))
        text = text[:at] + put + text[at + cut :]
    usable_or_refused(text)
