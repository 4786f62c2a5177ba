# SPDX-License-Identifier: Apache-2.0
"""YAML as people, ROS and OpenCV write it."""

from __future__ import annotations

from typing import Any

from grasptrack.errors import InputError


def read_yaml(text: str) -> Any:
    """The first document of YAML as dictionaries, lists, numbers and words: as people and ROS write it, and OpenCV's dialect.

    Raises:
        InputError: it cannot be read; the message names the line.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.constructor import SafeConstructor
    from ruamel.yaml.error import MarkedYAMLError
    from ruamel.yaml.nodes import MappingNode, ScalarNode

    class Constructor(SafeConstructor):
        """A safe one that takes what has a tag of its own, such as OpenCV's matrices, as if it had none."""

        def construct_tagged(self, node: Any) -> Any:
            if isinstance(node, ScalarNode):
                return self.construct_scalar(node)
            if isinstance(node, MappingNode):
                return self.construct_mapping(node, deep=True)
            return self.construct_sequence(node, deep=True)

    Constructor.add_constructor("tag:yaml.org,2002:opencv-matrix", Constructor.construct_tagged)
    Constructor.add_constructor(None, Constructor.construct_tagged)
    yaml = YAML(typ="safe", pure=True)
    yaml.Constructor = Constructor
    try:
        found = next(iter(yaml.load_all(text)), None)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        why = error.problem or error.context or "unknown"
        raise InputError(
            f"line {mark.line + 1 if mark else 1} is no YAML that can be read: {' '.join(why.split())}"
        ) from None
    except RecursionError:
        raise InputError("line 1 begins what is nested too deeply") from None
    except Exception as error:  # of ruamel's own, on what no rule foresees
        raise InputError(f"line 1 is no YAML that can be read: {' '.join(str(error).split())}") from None
    if isinstance(found, str):
        raise InputError("line 1 is no YAML that can be read: it has no key")
    return found
