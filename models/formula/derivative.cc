// SPDX-License-Identifier: Apache-2.0
#include "models/formula/derivative.h"

#include <cstddef>

namespace plenocal::formula {
namespace {

// Arithmetic on nodes.
struct Term {
  Graph* graph;
  int node;
};
Term operator+(Term a, Term b) { return {a.graph, a.graph->Make(Op::kAdd, a.node, b.node)}; }
Term operator-(Term a, Term b) { return {a.graph, a.graph->Make(Op::kSubtract, a.node, b.node)}; }
Term operator*(Term a, Term b) { return {a.graph, a.graph->Make(Op::kMultiply, a.node, b.node)}; }
Term operator/(Term a, Term b) { return {a.graph, a.graph->Make(Op::kDivide, a.node, b.node)}; }
Term operator-(Term a) { return {a.graph, a.graph->Make(Op::kNegate, a.node)}; }
Term Of(Op op, Term a) { return {a.graph, a.graph->Make(op, a.node)}; }
Term Of(Op op, Term a, Term b) { return {a.graph, a.graph->Make(op, a.node, b.node)}; }

// The derivative of f(a), less the factor a'.
Term Slope(Op op, Term f, Term a) {
  const auto number = [&](double value) { return Term{f.graph, f.graph->Constant(value)}; };
  const Term one = number(1);
  switch (op) {
    case Op::kNegate:
      return number(-1);
    case Op::kSqrt:
      return number(0.5) / f;
    case Op::kExp:
      return f;
    case Op::kLog:
      return one / a;
    case Op::kLog1p:
      return one / (one + a);
    case Op::kSin:
      return Of(Op::kCos, a);
    case Op::kCos:
      return -Of(Op::kSin, a);
    case Op::kTan:
      return one + f * f;
    case Op::kAsin:
      return one / Of(Op::kSqrt, one - a * a);
    case Op::kAcos:
      return number(-1) / Of(Op::kSqrt, one - a * a);
    case Op::kAtan:
      return one / (one + a * a);
    case Op::kSinh:
      return Of(Op::kCosh, a);
    case Op::kCosh:
      return Of(Op::kSinh, a);
    case Op::kTanh:
      return one - f * f;
    case Op::kSinc:
      return Of(Op::kSincSlope, a);
    case Op::kAbs: {
      const int negative = f.graph->Make(Op::kLess, a.node, number(0).node);
      return {f.graph, f.graph->Make(Op::kIf, negative, number(-1).node, one.node)};
    }
    default:
      return number(0);  // of conditions
  }
}

// The derivative of a node by those of its operands.
Term Derivative(Graph* graph, int node, const std::array<Term, 3>& d) {
  const Node n = (*graph)[node];
  const auto operand = [&](size_t i) { return Term{graph, n.of[i]}; };
  const auto is_zero = [&](Term term) { return graph->Is(term.node, 0); };
  const Term f{graph, node}, a = operand(0), b = operand(1);
  switch (n.op) {
    case Op::kAdd:
      return d[0] + d[1];
    case Op::kSubtract:
      return d[0] - d[1];
    case Op::kMultiply:
      return d[0] * b + a * d[1];
    case Op::kDivide:
      return (d[0] - f * d[1]) / b;
    case Op::kIf:
      return {graph, graph->Make(Op::kIf, a.node, d[1].node, d[2].node)};
    case Op::kAtan2:
      return (b * d[0] - a * d[1]) / (a * a + b * b);
    case Op::kAngleOverRadius: {
      const Term by_a = Of(Op::kAngleOverRadiusSlope, a, b);
      return by_a * d[0] - d[1] / (a + b * b);
    }
    case Op::kPow: {
      Term sum = d[0];
      if (!is_zero(sum)) {
        const Term less{graph, graph->Make(Op::kSubtract, b.node, graph->Constant(1))};
        sum = d[0] * b * Of(Op::kPow, a, less);
      }
      return is_zero(d[1]) ? sum : sum + d[1] * f * Of(Op::kLog, a);
    }
    default:
      return is_zero(d[0]) ? d[0] : Slope(n.op, f, a) * d[0];
  }
}

}  // namespace

std::vector<int> Derivatives(Graph* graph, std::span<const int> outputs, int input) {
  const std::vector<bool> needed = Needed(*graph, outputs);
  const int zero = graph->Constant(0), one = graph->Constant(1), size = graph->Size();
  std::vector<int> derivatives(static_cast<size_t>(size), zero);
  for (int node = 0; node < static_cast<int>(needed.size()); ++node) {
    const Node n = (*graph)[node];
    if (!needed[static_cast<size_t>(node)] || n.op == Op::kConstant || n.op == Op::kLess ||
        n.op == Op::kLessEqual) {
      continue;
    }
    int& derivative = derivatives[static_cast<size_t>(node)];
    if (n.op == Op::kInput) {
      derivative = n.of[0] == input ? one : zero;
      continue;
    }
    std::array<Term, 3> d{{{graph, zero}, {graph, zero}, {graph, zero}}};
    bool depends = false;
    for (size_t i = 0; i < 3; ++i) {
      if (n.of[i] >= 0) d[i].node = derivatives[static_cast<size_t>(n.of[i])];
      depends = depends || d[i].node != zero;
    }
    if (depends) derivative = Derivative(graph, node, d).node;
  }
  std::vector<int> result;
  for (const int output : outputs) result.push_back(derivatives[static_cast<size_t>(output)]);
  return result;
}

}  // namespace plenocal::formula
