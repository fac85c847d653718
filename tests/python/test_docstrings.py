# SPDX-License-Identifier: Apache-2.0
"""`help` explains every argument of what the module offers."""

from __future__ import annotations

import inspect
import re
from typing import Any, Iterator

import pytest

import plenocal


def _functions() -> Iterator[tuple[str, Any]]:
    for name in plenocal.__all__:
        value = getattr(plenocal, name)
        if inspect.isfunction(value):
            yield name, value
        for member, function in vars(value).items() if inspect.isclass(value) else ():
            function = getattr(function, "__func__", function)
            if inspect.isfunction(function) and not (member.startswith("_") and member != "__init__"):
                yield f"{name}.{member}", function


FUNCTIONS = {
    name: function for name, function in _functions() if function.__module__.startswith("plenocal")
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_help_explains_every_argument(name: str) -> None:
    text = inspect.getdoc(FUNCTIONS[name]) or ""
    owner = getattr(plenocal, name.split(".")[0])
    if name.endswith(".__init__"):
        text += inspect.getdoc(owner) or ""
    assert text, name
    for argument in inspect.signature(FUNCTIONS[name]).parameters:
        assert argument in ("self", "cls") or re.search(rf"\b{argument}\b", text), argument
    if FUNCTIONS[name].__module__ in ("plenocal.commands", "plenocal.images"):
        explained = re.findall(r"^    (\w+): ", text.split("Args:\n")[1], re.MULTILINE)
        assert explained == [*inspect.signature(FUNCTIONS[name]).parameters]
