# SPDX-License-Identifier: Apache-2.0
"""Places in C++ functions that can be changed (bench/mutants), found by libclang; sources with all changes behind switches."""
import re

from clang.cindex import CursorKind as Kind, TypeKind

TOP = '#include "plenocal_mutant.h"\n' + "".join(
    f'#pragma GCC diagnostic ignored "-W{name}"\n'
    for name in ("sign-compare", "parentheses", "maybe-uninitialized", "extra", "unused", "bool-compare", "int-in-bool-context",
                 "duplicated-branches", "logical-op", "array-bounds", "float-equal", "aggressive-loop-optimizations", "uninitialized",
                 "div-by-zero", "overflow", "type-limits", "tautological-compare", "shift-count-overflow", "shift-count-negative", "nonnull",
                 "null-dereference", "stringop-overread", "format-truncation", "dangling-pointer",
                 "free-nonheap-object", "infinite-recursion", "empty-body"))
FUNCTIONS = {Kind.FUNCTION_DECL, Kind.FUNCTION_TEMPLATE, Kind.CXX_METHOD, Kind.CONSTRUCTOR, Kind.DESTRUCTOR,
             Kind.CONVERSION_FUNCTION}
INTEGERS = {getattr(TypeKind, name) for name in
            "BOOL CHAR_U UCHAR USHORT UINT ULONG ULONGLONG CHAR_S SCHAR SHORT INT LONG LONGLONG".split()}
NUMBERS = INTEGERS | {TypeKind.FLOAT, TypeKind.DOUBLE, TypeKind.LONGDOUBLE}
BOUNDARY = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
OPERATORS = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!=", "!=": "==", "&&": "||", "||": "&&", "+": "-", "-": "+",
             "*": "/", "/": "*", "%": "*", "+=": "-=", "-=": "+=", "*=": "/=", "/=": "*="}
COMPARISONS = {"==", "!=", *BOUNDARY}
SYMMETRIC = {"min", "max", "hypot", "swap", "minmax"}


class Point:
    """A place that can be changed. Each of `edits` is (begin, end, text before, text after), "(#)" in it the mutant's number."""

    def __init__(self, path, line, original, mutated, edits):
        self.path, self.line, self.original, self.mutated, self.edits = path, line, original, mutated, edits


class Finder:
    """All points of a source file of a translation unit."""

    def __init__(self, path, unit):
        self.path, self.points = path, []
        self.source = path.read_bytes().decode("latin-1")  # offsets are bytes
        for cursor in unit.cursor.get_children():
            if cursor.location.file and cursor.location.file.name == str(path):
                self.find_functions(cursor)

    def text(self, begin, end):
        return " ".join(re.sub(r"//[^\n]*\n", "\n", self.source[begin:end]).split())

    def text_of(self, cursor):
        return self.text(cursor.extent.start.offset, cursor.extent.end.offset)

    def add(self, cursor, mutated, before, after, end=None):
        begin, end = cursor.extent.start.offset, end or cursor.extent.end.offset
        edits = [(begin, end, before, after)]
        self.points.append(Point(self.path, cursor.extent.start.line, self.text(begin, end), mutated, edits))

    def replace(self, cursor, mutated):
        self.add(cursor, mutated, f"(plenocal_mutant(#) ? {mutated} : ", ")")

    def negate(self, cursor):
        if cursor.kind == Kind.BINARY_OPERATOR and self.operator_of_numbers(*cursor.get_children()) in COMPARISONS:
            return  # the comparison's opposite is this change
        self.add(cursor, f"!({self.text_of(cursor)})", "(plenocal_mutant(#) != static_cast<bool>(", "))")

    def find_functions(self, cursor):
        if cursor.kind in FUNCTIONS:
            for child in cursor.get_children():
                if child.kind == Kind.COMPOUND_STMT:
                    self.visit(child)
        elif not cursor.kind.is_expression():
            for child in cursor.get_children():
                self.find_functions(child)

    def visit(self, cursor):
        children = list(cursor.get_children())
        skipped = []
        if cursor.kind in (Kind.PARM_DECL, Kind.STATIC_ASSERT):
            return
        if cursor.kind == Kind.VAR_DECL:
            if "constexpr" in self.source[cursor.extent.start.offset:cursor.location.offset].split():
                return
            if cursor.type.get_array_size() >= 0:
                skipped = [child for child in children if child.kind == Kind.INTEGER_LITERAL]
        if cursor.kind == Kind.CASE_STMT:
            skipped = children[:1]
        if cursor.kind in (Kind.BINARY_OPERATOR, Kind.COMPOUND_ASSIGNMENT_OPERATOR) and len(children) == 2:
            self.change_operator(cursor, *children)
        elif cursor.kind in (Kind.INTEGER_LITERAL, Kind.FLOATING_LITERAL):
            self.change_literal(cursor)
        elif cursor.kind == Kind.UNARY_OPERATOR and re.match(r"-[^-\d.]", self.text_of(cursor)):
            if cursor.type.get_canonical().kind in NUMBERS:
                self.replace(cursor, self.text_of(children[0]))
        elif cursor.kind in (Kind.IF_STMT, Kind.WHILE_STMT, Kind.CONDITIONAL_OPERATOR):
            self.change_condition(cursor, children)
        elif cursor.kind == Kind.RETURN_STMT and children and children[0].type.get_canonical().kind == TypeKind.BOOL:
            self.negate(children[0])
        elif cursor.kind == Kind.CALL_EXPR and cursor.spelling not in SYMMETRIC:
            self.swap_arguments(list(cursor.get_arguments()))
        bodies = {Kind.COMPOUND_STMT: children, Kind.IF_STMT: children[1:][-2:], Kind.FOR_STMT: children[-1:],
                  Kind.CXX_FOR_RANGE_STMT: children[-1:], Kind.WHILE_STMT: children[-1:]}
        for child in bodies.get(cursor.kind, []):
            self.delete(child)
        for child in children:
            if child not in skipped:
                self.visit(child)

    def between(self, left, right):
        return self.text(left.extent.end.offset, right.extent.start.offset)

    def operator_of_numbers(self, left, right):
        kinds = {side.type.get_canonical().kind for side in (left, right)}
        return self.between(left, right) if kinds <= NUMBERS | {TypeKind.ENUM} else None

    def change_operator(self, cursor, left, right):
        operator = self.operator_of_numbers(left, right)
        if operator not in OPERATORS:
            return
        is_integer = left.type.get_canonical().kind in INTEGERS
        # Two numbers of measured values are equal by chance alone: their boundary counts against a literal only.
        others = [OPERATORS[operator]]
        if operator in BOUNDARY and (is_integer or re.fullmatch(r"[\d.]+", self.text_of(right))):
            others.append(BOUNDARY[operator])
        for other in others:
            self.replace(cursor, f"{self.text_of(left)} {other} {self.text_of(right)}")

    def change_literal(self, cursor):
        text = self.text_of(cursor)
        begin, end = cursor.extent.start.offset, cursor.extent.end.offset
        if self.source[begin - 1] == "<" or self.source[end] == ">":
            return  # an argument of a template
        if cursor.kind == Kind.INTEGER_LITERAL and re.fullmatch(r"(0x[\da-fA-F]+|[\d']+)[uUlL]*", text):
            self.replace(cursor, f"({text} + 1)")
        elif cursor.kind == Kind.FLOATING_LITERAL and re.fullmatch(r"[\d.][\d.eE+'-]*", text):
            self.replace(cursor, f"(2 * {text})" if float(text.replace("'", "")) else "1.0")

    def change_condition(self, cursor, children):
        has_else = cursor.kind == Kind.IF_STMT and self.between(*children[-2:]).strip("; ") == "else"
        count = 3 if has_else or cursor.kind == Kind.CONDITIONAL_OPERATOR else 2
        condition = children[-count]
        inside = [child for child in children[:-count] if child.extent.end.offset >= condition.extent.end.offset]
        if condition.kind.is_expression() and not inside:
            self.negate(condition)

    def swap_arguments(self, arguments):
        for a, b in zip(arguments, arguments[1:]):
            kinds = [each.type.get_canonical().kind for each in (a, b)]
            texts = [self.text_of(each) for each in (a, b)]
            if kinds[0] not in NUMBERS or kinds[0] != kinds[1] or texts[0] == texts[1] or not all(texts):
                continue
            edits = [(each.extent.start.offset, each.extent.end.offset, f"(plenocal_mutant(#) ? {other} : ", ")")
                     for each, other in ((a, texts[1]), (b, texts[0]))]
            self.points.append(Point(self.path, a.extent.start.line, ", ".join(texts), ", ".join(texts[::-1]), edits))

    def delete(self, statement):
        semicolon = re.compile(r"\s*;").match(self.source, statement.extent.end.offset)
        while statement.kind == Kind.UNEXPOSED_EXPR and len(children := list(statement.get_children())) == 1:
            statement = children[0]
        if semicolon and statement.kind in (Kind.COMPOUND_ASSIGNMENT_OPERATOR, Kind.CALL_EXPR, Kind.BINARY_OPERATOR):
            self.add(statement, "", "{ if (!plenocal_mutant(#)) ", " }", semicolon.end())


def replaced(path, source, text, mistaken):
    """The point where `text`, a statement with its semicolon or an expression, stands once in a source."""
    if source.count(text) != 1:
        raise ValueError(f"{path}: `{text}` is not once in it")
    begin = source.index(text)
    before, after = f"(plenocal_mutant(#) ? ({mistaken}) : (", "))"
    if text.endswith(";"):
        before, after = f"{{ if (plenocal_mutant(#)) {{ {mistaken} }} else {{ ", " } }"
    return Point(path, source.count("\n", 0, begin) + 1, text, mistaken, [(begin, begin + len(text), before, after)])


def rewrite(source, points):
    """The text of a file with its points, a list of (number, point), and where each is: (begin, end, number)."""
    edits = sorted((begin, -end, order, number, before, after) for order, (number, point) in enumerate(points)
                   for begin, end, before, after in point.edits)
    text, places, inside, done = TOP, [], [], 0

    def close_until(position):
        nonlocal text, done
        while inside and inside[-1][0] <= position:
            end, after, begin, number = inside.pop()
            text += source[done:end] + after
            done = end
            places.append((begin, len(text), number))

    for begin, end, _, number, before, after in edits:
        close_until(begin)
        text += source[done:begin]
        done = begin
        inside.append((-end, after, len(text), number))
        text += before.replace("(#)", f"({number})")
    close_until(len(source))
    return text + source[done:], places


def refused(path, text, places, messages):
    """The numbers of the points in which the compiler sees errors, else those of the same lines."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    numbers = set()
    for line, column in re.findall(rf"^{re.escape(str(path))}:(\d+):(\d+): +(?:error|required from)", messages, re.M):
        begin_of_line, end_of_line = starts[int(line) - 1:int(line) + 1]
        offset = begin_of_line + int(column) - 1
        around = sorted((end - begin, number) for begin, end, number in places if begin <= offset < end)
        same_line = {number for begin, end, number in places if begin < end_of_line and end > begin_of_line}
        numbers |= {around[0][1]} if around else same_line
    return numbers
