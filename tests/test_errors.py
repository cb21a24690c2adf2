"""Messages of unknown names, and errors on their way between processes."""

import pickle

import pytest

from engines.errors import ConfigError, RaybenchError, SceneError, UnknownName, Unsupported, suggestion, why_unsupported


def test_the_nearest_name_is_proposed_before_the_list():
    assert suggestion("numbaa", ["numpy", "numba"]) == "did you mean 'numba'? known: numba, numpy"


def test_a_name_far_from_all_gets_the_list_alone():
    assert suggestion("xyz", ["numpy", "numba"]) == "known: numba, numpy"


def test_no_known_name_is_said():
    assert suggestion("xyz", []) == "known: none"


def test_known_names_may_be_an_iterator():
    error = UnknownName("engine", "numbaa", iter(["numpy", "numba"]))
    assert str(error) == "unknown engine 'numbaa': did you mean 'numba'? known: numba, numpy"


@pytest.mark.parametrize(
    "error", [UnknownName("engine", "x", ["y"]), Unsupported("no planes"), SceneError("a:1"), ConfigError("b")]
)
def test_an_error_survives_the_way_from_a_worker_process(error):
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is type(error)
    assert str(back) == str(error)


@pytest.mark.parametrize("kind", [UnknownName, Unsupported, SceneError, ConfigError])
def test_every_error_of_input_has_one_base(kind):
    assert issubclass(kind, RaybenchError)


@pytest.mark.parametrize("kind", [RaybenchError, SceneError, ConfigError, Unsupported])
def test_a_message_is_one_line_whatever_it_quotes(kind):
    error = kind("m\n\r\u2028.obj: \x1b[31mred\x07 \udc80 is ö")
    assert str(error) == r"m\n\r\u2028.obj: \x1b[31mred\x07 \udc80 is ö"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    assert "\n" not in str(UnknownName("engine", "a\nb", ["c\nd"]))


def test_why_unsupported_gives_the_words_and_lets_other_errors_pass():
    def lacks(word):
        raise Unsupported(f"no {word}")

    def wrong():
        raise ConfigError("wrong")

    assert why_unsupported(lacks, "hats") == "no hats"
    assert why_unsupported(str, 1) is None
    with pytest.raises(ConfigError):
        why_unsupported(wrong)
