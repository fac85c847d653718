// SPDX-License-Identifier: Apache-2.0
#include "models/formula/tape.h"

#include <algorithm>

#include "calib/kernels/processors.h"
#include "models/formula/operations.h"

namespace plenocal::formula {
namespace {

struct Registers {
  std::vector<int> free;
  int count = 0;

  int Take() {
    if (free.empty()) return count++;
    const int taken = free.back();
    free.pop_back();
    return taken;
  }
};

// By node: the last node that uses it; outputs are used to the end.
std::vector<int> LastUses(const Graph& graph,
                          const std::vector<bool>& needed,
                          std::span<const int> outputs) {
  std::vector<int> last(needed.size(), -1);
  for (int node = 0; node < graph.Size(); ++node) {
    if (!needed[static_cast<size_t>(node)] || graph[node].op == Op::kInput) continue;
    for (const int of : graph[node].of) {
      if (of >= 0) last[static_cast<size_t>(of)] = node;
    }
  }
  for (const int output : outputs) last[static_cast<size_t>(output)] = graph.Size();
  return last;
}

// Operations over a block: the loops are compiled for wide registers.
template <typename Instruction>
PLENOCAL_FOR_EACH_PROCESSOR [[gnu::flatten]] void RunBlock(const std::vector<Instruction>& all,
                                                           size_t count,
                                                           double* registers) {
  for (const Instruction& i : all) {
    const auto at = [&](int place) { return registers + static_cast<size_t>(place) * kBlock; };
    double* __restrict const to = at(i.to);
    const double *const a = at(i.a), *const b = at(i.b), *const c = at(i.c);
    WithOperation(i.op, [&](auto op) {
      for (size_t k = 0; k < count; ++k) to[k] = Apply<op.value>(a[k], b[k], c[k]);
    });
  }
}

template <typename Instruction>
[[gnu::flatten]] void RunPoint(const std::vector<Instruction>& all, double* registers) {
  for (const Instruction& i : all) {
    WithOperation(i.op, [&](auto op) {
      registers[i.to] = Apply<op.value>(registers[i.a], registers[i.b], registers[i.c]);
    });
  }
}

}  // namespace

Tape::Tape(const Graph& graph, std::span<const int> outputs, size_t varying) {
  const std::vector<bool> needed = Needed(graph, outputs);
  const std::vector<int> last = LastUses(graph, needed, outputs);
  Registers registers;
  std::vector<int> place(needed.size(), 0);
  for (int node = 0; node < graph.Size(); ++node) {
    const auto n = static_cast<size_t>(node);
    const Node& of = graph[node];
    if (!needed[n] || (of.op != Op::kConstant && of.op != Op::kInput)) continue;
    place[n] = registers.Take();
    const bool varies = of.op == Op::kInput && static_cast<size_t>(of.of[0]) < varying;
    const int input = of.op == Op::kConstant ? -1
                      : varies               ? of.of[0]
                                             : of.of[0] - static_cast<int>(varying);
    (varies ? loaded_ : filled_).push_back({place[n], input, of.value});
  }
  for (int node = 0; node < graph.Size(); ++node) {
    const auto n = static_cast<size_t>(node);
    const Node& of = graph[node];
    if (!needed[n] || of.op == Op::kConstant || of.op == Op::kInput) continue;
    place[n] = registers.Take();  // before those of the operands are free: never one of them
    const auto at = [&](size_t i) {
      return of.of[i] < 0 ? 0 : place[static_cast<size_t>(of.of[i])];
    };
    instructions_.push_back({of.op, place[n], at(0), at(1), at(2)});
    for (size_t i = 0; i < 3; ++i) {
      const int operand = of.of[i];
      if (operand < 0 || last[static_cast<size_t>(operand)] != node ||
          std::find(of.of.begin(), of.of.begin() + i, operand) != of.of.begin() + i ||
          graph[operand].op == Op::kConstant || graph[operand].op == Op::kInput) {
        continue;
      }
      registers.free.push_back(place[static_cast<size_t>(operand)]);
    }
  }
  for (const int output : outputs) outputs_.push_back(place[static_cast<size_t>(output)]);
  registers_ = static_cast<size_t>(registers.count);
}

Tape::Values Tape::Evaluate(const double* inputs, const double* params, size_t count) const {
  thread_local std::vector<double> memory;
  const size_t stride = count == 1 ? 1 : kBlock;
  if (memory.size() < registers_ * stride) memory.resize(registers_ * stride);
  for (const Filled& in : loaded_) {
    std::copy_n(inputs + static_cast<size_t>(in.input) * kBlock,
                count,
                memory.data() + static_cast<size_t>(in.to) * stride);
  }
  for (const Filled& in : filled_) {
    std::fill_n(memory.data() + static_cast<size_t>(in.to) * stride,
                count,
                in.input < 0 ? in.value : params[in.input]);
  }
  if (count == 1) {
    RunPoint(instructions_, memory.data());
  } else {
    RunBlock(instructions_, count, memory.data());
  }
  return {memory.data(), outputs_.data(), stride};
}

}  // namespace plenocal::formula
