// SPDX-License-Identifier: Apache-2.0
#include "models/formula/graph.h"

#include <bit>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "calib/base/format_error.h"

namespace plenocal::formula {

int Graph::Add(const Node& node) {
  const auto [place, is_new] = known_.try_emplace(
      {node.op, node.of[0], node.of[1], node.of[2], std::bit_cast<uint64_t>(node.value)}, Size());
  if (!is_new) return place->second;
  if (Size() >= limit_) {
    throw InputError("has more than {} terms with its derivatives; shorten it", limit_);
  }
  nodes_.push_back(node);
  return Size() - 1;
}

int Graph::Constant(double value) { return Add({.op = Op::kConstant, .value = value}); }
int Graph::Input(int number) { return Add({.op = Op::kInput, .of = {number, -1, -1}}); }

bool Graph::Is(int node, double value) const {
  return node >= 0 && (*this)[node].op == Op::kConstant && (*this)[node].value == value;
}

int Graph::Simpler(Op op, int a, int b) {
  switch (op) {
    case Op::kAdd:
      return Is(a, 0) ? b : Is(b, 0) ? a : -1;
    case Op::kSubtract:
      return Is(b, 0) ? a : Is(a, 0) ? Make(Op::kNegate, b) : -1;
    case Op::kMultiply:
      if (Is(a, 0) || Is(b, 1)) return a;
      if (Is(b, 0) || Is(a, 1)) return b;
      return Is(a, -1) ? Make(Op::kNegate, b) : Is(b, -1) ? Make(Op::kNegate, a) : -1;
    case Op::kDivide:
      return Is(a, 0) || Is(b, 1) ? a : -1;
    case Op::kNegate:
      return (*this)[a].op == Op::kNegate ? (*this)[a].of[0] : -1;
    default:
      return -1;
  }
}

int Graph::Make(Op op, int a, int b, int c) {
  if (const int simpler = Simpler(op, a, b); simpler >= 0) return simpler;
  if (op == Op::kIf && b == c) return b;
  const auto is_constant = [&](int node) { return node < 0 || (*this)[node].op == Op::kConstant; };
  const auto value = [&](int node) { return node < 0 ? 0 : (*this)[node].value; };
  if (op == Op::kIf && is_constant(a)) return value(a) != 0 ? b : c;
  if (is_constant(a) && is_constant(b) && is_constant(c)) {
    double folded = 0;
    WithOperation(op, [&](auto of) { folded = Apply<of.value>(value(a), value(b), value(c)); });
    return Constant(folded);
  }
  if ((op == Op::kAdd || op == Op::kMultiply) && b < a) std::swap(a, b);
  if (op == Op::kLog && (*this)[a].op == Op::kAdd) {  // log(1 + x) of a small x loses its digits
    const auto [first, second, none] = (*this)[a].of;
    if (Is(first, 1)) return Make(Op::kLog1p, second);
    if (Is(second, 1)) return Make(Op::kLog1p, first);
  }
  return Add({.op = op, .of = {a, b, c}});
}

int Graph::Power(int base, int exponent) {
  constexpr double kUnrolled = 16;
  const Node power = (*this)[exponent];
  if (power.op == Op::kConstant && power.value == 0.5) return Make(Op::kSqrt, base);
  if (power.op != Op::kConstant || power.value != std::round(power.value) ||
      std::abs(power.value) > kUnrolled) {
    return Make(Op::kPow, base, exponent);
  }
  int result = Constant(1), square = base;
  for (int left = std::abs(static_cast<int>(power.value)); left > 0; left /= 2) {
    if (left % 2 == 1) result = Make(Op::kMultiply, result, square);
    if (left > 1) square = Make(Op::kMultiply, square, square);
  }
  return power.value < 0 ? Make(Op::kDivide, Constant(1), result) : result;
}

std::vector<bool> Needed(const Graph& graph, std::span<const int> outputs) {
  std::vector<bool> needed(static_cast<size_t>(graph.Size()), false);
  for (const int output : outputs) needed[static_cast<size_t>(output)] = true;
  for (int node = graph.Size() - 1; node >= 0; --node) {
    if (!needed[static_cast<size_t>(node)] || graph[node].op == Op::kInput) continue;
    for (const int of : graph[node].of) {
      if (of >= 0) needed[static_cast<size_t>(of)] = true;
    }
  }
  return needed;
}

}  // namespace plenocal::formula
