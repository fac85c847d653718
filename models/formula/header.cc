// SPDX-License-Identifier: Apache-2.0
#include "models/formula/header.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cctype>
#include <cmath>
#include <map>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"

namespace plenocal::formula {
namespace {

std::string Literal(double value) {
  const std::string text = fmt::format("{}", value);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
}

std::string CamelCase(std::string_view name) {
  std::string text;
  bool first = true;
  for (const char c : name) {
    if (c != '-')
      text += first ? static_cast<char>(std::toupper(static_cast<unsigned char>(c))) : c;
    first = c == '-';
  }
  return text;
}

const std::map<Op, std::string_view>& Calls() {
  static const std::map<Op, std::string_view> kCalls{
      {Op::kSqrt, "sqrt({0})"},
      {Op::kExp, "exp({0})"},
      {Op::kLog, "log({0})"},
      {Op::kLog1p, "log1p({0})"},
      {Op::kSin, "sin({0})"},
      {Op::kCos, "cos({0})"},
      {Op::kTan, "tan({0})"},
      {Op::kAsin, "asin({0})"},
      {Op::kAcos, "acos({0})"},
      {Op::kAtan, "atan({0})"},
      {Op::kSinh, "sinh({0})"},
      {Op::kCosh, "cosh({0})"},
      {Op::kTanh, "tanh({0})"},
      {Op::kAbs, "abs({0})"},
      {Op::kAtan2, "atan2({0}, {1})"},
      {Op::kPow, "pow({0}, {1})"},
      {Op::kAdd, "{0} + {1}"},
      {Op::kSubtract, "{0} - {1}"},
      {Op::kMultiply, "{0} * {1}"},
      {Op::kDivide, "{0} / {1}"},
      {Op::kNegate, "-{0}"},
      {Op::kIf, "{0} ? T({1}) : T({2})"},
      {Op::kLess, "ValueOf({0}) < ValueOf({1})"},
      {Op::kLessEqual, "ValueOf({0}) <= ValueOf({1})"},
      {Op::kSinc, "ValueOf({0}) == 0.0 ? T(1.0) : T(sin({0}) / {0})"},
      {Op::kAngleOverRadius, "AngleOverRadius(T({0}), T({1}))"}};
  return kCalls;
}

std::string NameOf(const Graph& graph, int node, std::span<const std::string> inputs) {
  const Node& n = graph[node];
  if (n.op == Op::kConstant) return Literal(n.value);
  const auto input = static_cast<size_t>(n.of[0]);
  if (n.op == Op::kInput) {
    return input < inputs.size() ? inputs[input] : fmt::format("k[{}]", input - inputs.size());
  }
  return fmt::format("n_{}", node);
}

// Statements that compute nodes, one each.
std::string Statements(const Graph& graph,
                       std::span<const int> outputs,
                       std::span<const std::string> inputs) {
  std::string text =
      "    using std::abs, std::acos, std::asin, std::atan, std::atan2, std::cos, std::cosh, std::exp,\n"
      "        std::log, std::log1p, std::pow, std::sin, std::sinh, std::sqrt, std::tan, std::tanh;\n";
  const std::vector<bool> needed = Needed(graph, outputs);
  for (int node = 0; node < graph.Size(); ++node) {
    const Node& n = graph[node];
    if (!needed[static_cast<size_t>(node)] || n.op == Op::kConstant || n.op == Op::kInput) continue;
    const auto of = [&](size_t i) {
      return n.of[i] < 0 ? std::string() : NameOf(graph, n.of[i], inputs);
    };
    const bool is_condition = n.op == Op::kLess || n.op == Op::kLessEqual;
    text += fmt::format("    const {} n_{} = {};\n",
                        is_condition ? "bool" : "T",
                        node,
                        fmt::format(fmt::runtime(Calls().at(n.op)), of(0), of(1), of(2)));
  }
  return text;
}

std::string Declarations(const CameraModel& model, std::span<const std::vector<double>> starts) {
  std::vector<std::string> params, lists;
  for (const Param& param : model.params.subspan(4)) {
    std::string text =
        fmt::format(".name = \"{}\", .unit = {}", param.name, YamlQuoted(param.unit));
    if (std::isfinite(param.lower)) text += ", .lower = " + Literal(param.lower);
    if (std::isfinite(param.upper)) text += ", .upper = " + Literal(param.upper);
    text += ", .scale = " + Literal(param.scale);
    if (param.neutral) text += ", .neutral = " + Literal(*param.neutral);
    params.push_back(fmt::format("Param{{{}}}", text));
  }
  const auto list = [](std::span<const double> values) {
    std::vector<std::string> texts;
    for (const double value : values) texts.push_back(Literal(value));
    return fmt::format("{}", fmt::join(texts, ", "));
  };
  for (const std::vector<double>& start : starts) {
    lists.push_back(fmt::format("std::array<double, {}>{{{}}}", params.size(), list(start)));
  }
  return fmt::format(
      "  static constexpr std::string_view kName = \"{}\";\n"
      "  static constexpr std::string_view kSource = {};\n"
      "  static constexpr auto kParams = WithIntrinsics<{}>({{{}}});\n"
      "  static constexpr std::array kExample{{{}}};\n"
      "  static constexpr std::array kStart{{{}}};\n",
      model.name,
      YamlQuoted(model.source),
      params.size(),
      fmt::join(params, ",\n      "),
      list(model.example),
      fmt::join(lists, ", "));
}

constexpr const char* kRadiusHeader = R"(
  template <typename T>
  static bool Map(const T* k, const Vector3<T>& p, T* m) {{
    using std::atan2, std::sqrt;
    const T r2 = p.x() * p.x() + p.y() * p.y();
    if (!({0})) return false;
    constexpr double kNearAxis = 1e-6;
    T gain;
    if (p.z() > 0.0 && ValueOf(r2) < 1e-20) {{
      gain = Radius(k, T(kNearAxis)) / (kNearAxis * p.z());
    }} else {{
      const T r = sqrt(r2);
      const T t = {1};
      std::array<double, {2}> value{{}};
      for (size_t i = 0; i < value.size(); ++i) value[i] = ValueOf(k[i]);
      if (!Grows(value.data(), ValueOf(t))) return false;
      gain = Radius(k, t) / r;
    }}
    m[0] = p.x() * gain;
    m[1] = p.y() * gain;
    return true;
  }}

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {{
    const double radius = m.norm();
    const std::optional<double> t =
        SolveIncreasing([&](double at) {{ return Radius(k, at); }},
                        [&](double at) {{ return Slope(k, at); }},
                        [&](double at) {{ return {3}Grows(k, at); }},
                        radius);
    if (!t) return std::nullopt;
    const double lateral = radius > 0 ? {4} / radius : 1;
    return Eigen::Vector3d(m.x() * lateral, m.y() * lateral, {5});
  }}

 private:
  template <typename T>
  static T Radius(const T* k, const T& t) {{
{6}    return {7};
  }}
  static double Slope(const double* k, double t) {{
    using Jet = ceres::Jet<double, 1>;
    std::array<Jet, {2}> k_jet;
    for (size_t i = 0; i < k_jet.size(); ++i) k_jet[i] = Jet(k[i]);
    return Radius(k_jet.data(), Jet(t, 0)).v[0];
  }}
  // Whether the radius grows over all of [0, t]. Sampled: a closed form is faster.
  static bool Grows(const double* k, double t) {{
    constexpr int kSamples = 64;
    for (int i = 1; i <= kSamples; ++i) {{
      if (!(Slope(k, t * i / kSamples) > 0)) return false;
    }}
    return true;
  }}
)";

constexpr const char* kMapHeader = R"(
  template <typename T>
  static bool Map(const T* k, const Vector3<T>& p, T* m) {{
{0}    if (!({1})) return false;
    m[0] = {2};
    m[1] = {3};
    return true;
  }}

  static std::optional<Eigen::Vector3d> Unmap(const double* k, const Eigen::Vector2d& m) {{
    using T = double;
{4}    const Eigen::Vector3d p({5}, {6}, {7});
    // Another root of the equations lies elsewhere.
    Eigen::Vector2d again;
    if (!p.allFinite() || !Map(k, Vector3<double>(p / p.cwiseAbs().maxCoeff()), again.data()) ||
        !((again - m).norm() <= 1e-6 * (1 + m.norm()))) {{
      return std::nullopt;
    }}
    return p;
  }}
)";

std::string RadiusBody(const LensNodes& nodes) {
  if (!nodes.conditions.empty()) {
    throw InputError("a header of a radius with 'domain' is not written; remove the domain");
  }
  const std::vector<std::string> inputs{"t"};
  const bool angle = nodes.of_angle;
  return fmt::format(kRadiusHeader,
                     angle ? "r2 > 0.0 || p.z() > 0.0" : "p.z() > 0.0",
                     angle ? "atan2(r, p.z())" : "r / p.z()",
                     nodes.param_count,
                     angle ? "at <= std::numbers::pi && " : "",
                     angle ? "std::sin(*t)" : "*t",
                     angle ? "std::cos(*t)" : "1",
                     Statements(nodes.graph, nodes.outputs, inputs),
                     NameOf(nodes.graph, nodes.outputs[0], inputs));
}

std::string MapBody(const LensNodes& nodes) {
  if (nodes.conditions.empty() || nodes.unmap.empty()) {
    throw InputError("a header of a map needs the formula's 'domain' and 'unmap'");
  }
  const std::vector<std::string> inputs{"p.x()", "p.y()", "p.z()"}, of_pixel{"m.x()", "m.y()", ""};
  std::vector<int> all = nodes.outputs;
  all.insert(all.end(), nodes.conditions.begin(), nodes.conditions.end());
  std::vector<std::string> conditions;
  for (const int node : nodes.conditions) conditions.push_back(NameOf(nodes.graph, node, inputs));
  const auto map = [&](size_t i) { return NameOf(nodes.graph, nodes.outputs[i], inputs); };
  const auto back = [&](size_t i) { return NameOf(nodes.graph, nodes.unmap[i], of_pixel); };
  return fmt::format(kMapHeader,
                     Statements(nodes.graph, all, inputs),
                     fmt::join(conditions, " && "),
                     map(0),
                     map(1),
                     Statements(nodes.graph, nodes.unmap, of_pixel),
                     back(0),
                     back(1),
                     back(2));
}

}  // namespace

std::string HeaderText(const CameraModel& model,
                       const LensNodes& nodes,
                       std::span<const std::vector<double>> starts) {
  if (nodes.form == Form::kRay) {
    throw InputError("a header of a ray is not written; state the lens as radius or map");
  }
  return fmt::format(
      "// SPDX-License-Identifier: Apache-2.0\n//\n"
      "// Made by 'plenocal models --header {0}' from a formula.\n#pragma once\n\n"
      "#include <numbers>\n\n#include \"models/start/central_model.h\"\n\nnamespace plenocal {{\n\n"
      "struct {1} : LensModel<{1}> {{\n{2}{3}}};\n\n}}  // namespace plenocal\n",
      model.name,
      CamelCase(model.name),
      Declarations(model, starts),
      nodes.form == Form::kRadius ? RadiusBody(nodes) : MapBody(nodes));
}

}  // namespace plenocal::formula
