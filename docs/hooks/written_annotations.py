"""Griffe's extension: annotations as the source has them, so that jaxtyping's shapes stay strings.

Griffe takes the string in `Float[np.ndarray, "n"]` for a forward reference and prints `n`.
"""

import ast

import griffe


class WrittenAnnotations(griffe.Extension):
    """Replaces the parsed annotations of functions and attributes by their source."""

    def on_function_instance(self, *, node: ast.AST, func: griffe.Function, **_: object) -> None:
        """Arguments and the returned value of a function."""
        if not isinstance(node, ast.FunctionDef):
            return
        func.returns = _source(node.returns)
        every = node.args
        for argument in [*every.posonlyargs, *every.args, *every.kwonlyargs]:
            func.parameters[argument.arg].annotation = _source(argument.annotation)

    def on_attribute_instance(self, *, node: ast.AST, attr: griffe.Attribute, **_: object) -> None:
        """Properties, and the fields of a record, of which its signature is made."""
        if isinstance(node, ast.AnnAssign):
            attr.annotation = _source(node.annotation)
        elif isinstance(node, ast.FunctionDef):
            attr.annotation = _source(node.returns)


def _source(annotation: ast.expr | None) -> str | None:
    return None if annotation is None else ast.unparse(annotation).replace("'", '"')
