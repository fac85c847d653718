// SPDX-License-Identifier: Apache-2.0
#include "models/formula/grammar.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <numbers>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/names.h"

namespace plenocal::formula {
namespace {

// Functions that are one operation; the others are in `Parser::Call`.
struct Function {
  std::string_view name;
  Op op;
  size_t operands;
};
constexpr std::array kFunctions{
    Function{"sqrt", Op::kSqrt, 1},  Function{"exp", Op::kExp, 1},
    Function{"log", Op::kLog, 1},    Function{"log1p", Op::kLog1p, 1},
    Function{"sin", Op::kSin, 1},    Function{"cos", Op::kCos, 1},
    Function{"tan", Op::kTan, 1},    Function{"asin", Op::kAsin, 1},
    Function{"acos", Op::kAcos, 1},  Function{"atan", Op::kAtan, 1},
    Function{"sinh", Op::kSinh, 1},  Function{"cosh", Op::kCosh, 1},
    Function{"tanh", Op::kTanh, 1},  Function{"abs", Op::kAbs, 1},
    Function{"sinc", Op::kSinc, 1},  Function{"atan2", Op::kAtan2, 2},
    Function{"min", Op::kLess, 2},   Function{"max", Op::kLess, 2},
    Function{"hypot", Op::kSqrt, 2}, Function{"angle_over_radius", Op::kAngleOverRadius, 2},
    Function{"if", Op::kIf, 3},      Function{"sum", Op::kAdd, 4}};

bool StartsName(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0 || c == '_'; }
bool InName(char c) { return StartsName(c) || std::isdigit(static_cast<unsigned char>(c)) != 0; }

class Parser {
 public:
  Parser(std::string_view text, const Names& names, Graph* graph)
      : text_(text), names_(names), graph_(*graph) {}

  int All(bool condition) {
    const int node = condition ? Condition() : Sum();
    Blanks();
    if (at_ == text_.size()) return node;
    const bool compares = text_[at_] == '<' || text_[at_] == '>';
    Fail(at_,
         compares ? "a comparison stands only in 'domain' and first in if(...)"
                  : "expected an operator (+ - * / ^) or the end");
  }

 private:
  [[noreturn]] void Fail(size_t at, std::string_view reason) const {
    constexpr size_t kShown = 30;
    const std::string_view rest = text_.substr(std::min(at, text_.size()), kShown);
    throw InputError(
        "column {}, at '{}': {}", at + 1, rest.empty() ? "end of the formula" : rest, reason);
  }
  void Blanks() {
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_])) != 0) ++at_;
  }
  bool Skip(std::string_view token) {
    Blanks();
    if (!text_.substr(at_).starts_with(token)) return false;
    at_ += token.size();
    return true;
  }
  void Expect(std::string_view token) {
    if (Skip(token)) return;
    Fail(at_,
         fmt::format("expected '{}'; a formula with commas in [...] or {{...}} of YAML stands in "
                     "quotes",
                     token));
  }
  std::string_view Name() {
    Blanks();
    const size_t begin = at_;
    if (at_ < text_.size() && StartsName(text_[at_])) {
      while (at_ < text_.size() && InName(text_[at_])) ++at_;
    }
    return text_.substr(begin, at_ - begin);
  }

  int Condition() {
    const int left = Sum();
    const size_t at = at_;
    if (Skip("<=")) return graph_.Make(Op::kLessEqual, left, Sum());
    if (Skip("<")) return graph_.Make(Op::kLess, left, Sum());
    if (Skip(">=")) return graph_.Make(Op::kLessEqual, Sum(), left);
    if (Skip(">")) return graph_.Make(Op::kLess, Sum(), left);
    Fail(at, "expected a comparison: < <= > >=");
  }
  int Sum() {
    int node = Product();
    for (;;) {
      if (Skip("+")) {
        node = graph_.Make(Op::kAdd, node, Product());
      } else if (Skip("-")) {
        node = graph_.Make(Op::kSubtract, node, Product());
      } else {
        return node;
      }
    }
  }
  int Product() {
    int node = Signed();
    for (;;) {
      if (text_.substr(at_).starts_with("**")) Fail(at_, "a power is written x^2");
      if (Skip("*")) {
        node = graph_.Make(Op::kMultiply, node, Signed());
      } else if (Skip("/")) {
        node = graph_.Make(Op::kDivide, node, Signed());
      } else {
        return node;
      }
    }
  }
  // -x^2 is -(x^2).
  int Signed() {
    constexpr int kDeepest = 100;
    constexpr size_t kLongest = 20000;  // with what `sum` repeats
    if (++depth_ > kDeepest) Fail(at_, "more than 100 brackets or signs within each other");
    if (++steps_ > kLongest) Fail(at_, "longer than 20000 terms; shorten its sums");
    const int node = Skip("-")   ? graph_.Make(Op::kNegate, Signed())
                     : Skip("+") ? Signed()
                                 : Power();
    --depth_;
    return node;
  }
  int Power() {
    const int base = Primary();
    return Skip("^") ? graph_.Power(base, Signed()) : base;
  }
  int Primary() {
    if (Skip("(")) {
      const int node = Sum();
      Expect(")");
      return node;
    }
    const size_t begin = at_;
    const std::string_view name = Name();
    if (name.empty()) return Number();
    if (Skip("(")) return Call(name, begin);
    return Variable(name, begin);
  }
  int Number() {
    double value = 0;
    const char* const end = text_.data() + text_.size();
    const auto [rest, error] = std::from_chars(text_.data() + at_, end, value);
    if (at_ == text_.size() || error != std::errc() || !std::isfinite(value) || text_[at_] == '-') {
      Fail(at_, "expected a number, a name or '('");
    }
    at_ = static_cast<size_t>(rest - text_.data());
    return graph_.Constant(value);
  }
  int Variable(std::string_view name, size_t begin) {
    std::string full(name);
    for (const auto& [index, value] : indices_) {
      if (full == index) return graph_.Constant(value);
      if (full.ends_with("_" + index)) {
        full = full.substr(0, full.size() - index.size()) + std::to_string(value);
      }
    }
    if (const auto found = names_.find(full); found != names_.end()) {
      if (found->second < 0) Fail(begin, "is used before its definition; move that up");
      return found->second;
    }
    if (full == "pi") return graph_.Constant(std::numbers::pi);
    std::vector<std::string_view> known = NamesOf(kFunctions);
    for (const auto& entry : names_) known.push_back(entry.first);
    Fail(begin, fmt::format("unknown name '{}'{}", full, SuggestName(full, known)));
  }
  int Call(std::string_view name, size_t begin) {
    const auto function = std::ranges::find(kFunctions, name, &Function::name);
    if (function == kFunctions.end()) {
      Fail(begin,
           fmt::format("unknown function '{}'{}; a product is written with *",
                       name,
                       SuggestName(name, NamesOf(kFunctions))));
    }
    const int node = name == "sum" ? Repeated(begin) : Called(*function);
    graph_.Remember(node, text_.substr(begin, at_ - begin));
    return node;
  }
  int Called(const Function& function) {
    std::array<int, 4> of{-1, -1, -1, -1};
    for (size_t i = 0; i < function.operands; ++i) {
      if (i > 0) Expect(",");
      of[i] = i == 0 && function.op == Op::kIf ? Condition() : Sum();
    }
    Expect(")");
    if (function.op == Op::kLess) {
      const int less = graph_.Make(Op::kLess, of[0], of[1]);
      return function.name == "min" ? graph_.Make(Op::kIf, less, of[0], of[1])
                                    : graph_.Make(Op::kIf, less, of[1], of[0]);
    }
    if (function.name == "hypot") {
      const auto square = [&](int node) { return graph_.Make(Op::kMultiply, node, node); };
      return graph_.Make(Op::kSqrt, graph_.Make(Op::kAdd, square(of[0]), square(of[1])));
    }
    return graph_.Make(function.op, of[0], of[1], of[2]);
  }
  // sum(i, 1, 4, k_i*q^i)
  int Repeated(size_t begin) {
    const std::string index(Name());
    if (!IsName(index) || names_.contains(index)) {
      Fail(begin, "sum(i, 1, 4, k_i*q^i) begins with a name that has no other meaning");
    }
    const auto limit = [&] {
      Expect(",");
      const size_t at = at_;
      const Node node = graph_[Sum()];
      constexpr double kLargest = 1000;
      if (node.op != Op::kConstant || node.value != std::round(node.value) ||
          std::abs(node.value) > kLargest) {
        Fail(at, "expected an integer up to 1000");
      }
      return static_cast<int>(node.value);
    };
    const int first = limit(), last = limit();
    if (last < first) Fail(begin, "the sum has no terms");
    Expect(",");
    const size_t body = at_;
    int sum = graph_.Constant(0);
    for (int i = first; i <= last; ++i) {
      at_ = body;
      indices_.emplace_back(index, i);
      sum = graph_.Make(Op::kAdd, sum, Sum());
      indices_.pop_back();
    }
    Expect(")");
    return sum;
  }

  std::string_view text_;
  const Names& names_;
  Graph& graph_;
  size_t at_ = 0, steps_ = 0;
  int depth_ = 0;
  std::vector<std::pair<std::string, int>> indices_;  // of the sums around
};

}  // namespace

int Parse(std::string_view text, const Names& names, bool condition, Graph* graph) {
  return Parser(text, names, graph).All(condition);
}

bool IsName(std::string_view text) {
  return !text.empty() && StartsName(text[0]) && std::ranges::all_of(text, InName) &&
         text != "pi" && std::ranges::find(kFunctions, text, &Function::name) == kFunctions.end();
}

}  // namespace plenocal::formula
