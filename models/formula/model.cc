// SPDX-License-Identifier: Apache-2.0
#include "models/formula/model.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/files/image_keys.h"
#include "calib/files/session.h"
#include "calib/io/input_file.h"
#include "models/formula/defects.h"
#include "models/formula/grammar.h"
#include "models/formula/header.h"
#include "models/formula/lens.h"
#include "models/registry.h"
#include "models/start/central_model.h"

namespace plenocal {
namespace formula {
namespace {

constexpr size_t kIntrinsics = 4;
constexpr std::array<Param, kIntrinsics> kIntrinsicParams = WithIntrinsics<0>({});

// What a CameraModel of a formula refers to.
struct FormulaModel {
  std::string name, source;
  std::string text, file;          // YAML of the formula, and where it stands
  std::vector<std::string> texts;  // names and units of the lens' parameters
  std::vector<Param> params;       // all
  std::vector<double> example;
  std::vector<std::vector<double>> starts;  // of the lens' parameters, one list each
  std::unique_ptr<LensFormula> lens;
  LensNodes nodes;

  [[nodiscard]] size_t LensParams() const { return params.size() - kIntrinsics; }
};

const FormulaModel& Of(const CameraModel& model) {
  return *static_cast<const FormulaModel*>(model.self);
}

// --- projection ---

// A block with memory for the derivatives by parameters, which lasts until the next one.
LensBlock BlockFor(const FormulaModel& model, Need need) {
  LensBlock block;
  if (need != Need::kAll) return block;
  thread_local std::vector<double> by_k;
  by_k.resize(std::max(by_k.size(), 2 * model.LensParams() * kBlock));
  block.by_k = by_k.data();
  return block;
}

// Directions count only: scaled, no square overflows. False where there is none.
bool Put(double x, double y, double z, size_t i, LensBlock* block, double* size) {
  *size = std::max({std::abs(x), std::abs(y), std::abs(z)});
  const bool is_direction = *size >= std::numeric_limits<double>::min() && std::isfinite(x + y + z);
  if (!is_direction) {
    x = y = 0;
    z = *size = 1;
  }
  block->p[i] = x / *size;
  block->p[kBlock + i] = y / *size;
  block->p[2 * kBlock + i] = z / *size;
  return is_direction;
}

// Places in the output: number j of point i is at j * stride + i.
void Write(const FormulaModel& model,
           const double* params,
           const LensBlock& block,
           size_t i,
           double size,
           size_t stride,
           const ProjectionOutput& out) {
  const size_t count = model.params.size(), of_lens = model.LensParams();
  for (size_t r = 0; r < 2; ++r) {
    const double f = params[r], m = block.m[r * kBlock + i];
    out.predicted[r * stride] = f * m + params[2 + r];
    if (out.J_h != nullptr) out.J_h[r * stride] = 0;
    for (size_t j = 0; out.J_point != nullptr && j < 3; ++j) {
      out.J_point[(3 * r + j) * stride] = f * block.by_p[(3 * r + j) * kBlock + i] / size;
    }
    if (out.J_params == nullptr) continue;
    double* const row = out.J_params + r * count * stride;
    for (size_t j = 0; j < kIntrinsics; ++j) row[j * stride] = j == r ? m : j == 2 + r ? 1 : 0;
    for (size_t j = 0; j < of_lens; ++j) {
      row[(kIntrinsics + j) * stride] = f * block.by_k[(r * of_lens + j) * kBlock + i];
    }
  }
}

bool ProjectOne(const CameraModel& model,
                const double* params,
                const Eigen::Vector3d& p,
                Need need,
                const ProjectionOutput& out) {
  const FormulaModel& own = Of(model);
  LensBlock block = BlockFor(own, need);
  block.count = 1;
  double size = 1;
  if (!Put(p.x(), p.y(), p.z(), 0, &block, &size)) return false;
  own.lens->Map(params + kIntrinsics, need, &block);
  if (!block.inside[0]) return false;
  Write(own, params, block, 0, size, 1, out);
  return std::isfinite(out.predicted[0]) && std::isfinite(out.predicted[1]);
}

bool ProjectPoint(const CameraModel& model,
                  const double* params,
                  const double* /*config*/,
                  const double* /*values*/,
                  const Eigen::Vector3d& p,
                  double /*h*/,
                  double* predicted) {
  return ProjectOne(model, params, p, Need::kValue, {.predicted = predicted});
}

bool DifferentiatePoint(const CameraModel& model,
                        const double* params,
                        const double* /*config*/,
                        const double* /*values*/,
                        const Eigen::Vector3d& p,
                        double /*h*/,
                        const ProjectionOutput& out) {
  return ProjectOne(model, params, p, out.J_params == nullptr ? Need::kPoint : Need::kAll, out);
}

void ProjectBlock(const CameraModel& model,
                  const double* params,
                  const double* /*config*/,
                  const PointBlock& in,
                  const ProjectionOutput& out) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const FormulaModel& own = Of(model);
  const Need need = out.J_params != nullptr  ? Need::kAll
                    : out.J_point != nullptr ? Need::kPoint
                                             : Need::kValue;
  LensBlock block = BlockFor(own, need);
  std::array<double, kBlock> sizes;
  std::array<bool, kBlock> is_direction;
  for (size_t begin = 0; begin < in.count; begin += kBlock) {
    block.count = std::min(kBlock, in.count - begin);
    const double* const p = in.p + begin;
    for (size_t i = 0; i < block.count; ++i) {
      is_direction[i] = Put(p[i], p[in.count + i], p[2 * in.count + i], i, &block, &sizes[i]);
    }
    own.lens->Map(params + kIntrinsics, need, &block);
    for (size_t i = 0; i < block.count; ++i) {
      const auto at = [&](double* numbers) {
        return numbers == nullptr ? nullptr : numbers + begin + i;
      };
      const ProjectionOutput one{.predicted = at(out.predicted),
                                 .J_params = at(out.J_params),
                                 .J_point = at(out.J_point),
                                 .J_h = at(out.J_h)};
      Write(own, params, block, i, sizes[i], in.count, one);
      if (is_direction[i] && block.inside[i] && std::isfinite(one.predicted[0]) &&
          std::isfinite(one.predicted[in.count])) {
        continue;
      }
      const auto erase = [&](double* numbers, size_t width) {
        for (size_t j = 0; numbers != nullptr && j < width; ++j) numbers[j * in.count] = kNan;
      };
      erase(one.predicted, 2);
      erase(one.J_params, 2 * own.params.size());
      erase(one.J_point, 6);
      erase(one.J_h, 2);
    }
  }
}

std::optional<Ray> Unproject(const CameraModel& model,
                             const double* params,
                             const double* /*config*/,
                             const double* values) {
  const Eigen::Vector2d m((values[0] - params[2]) / params[0], (values[1] - params[3]) / params[1]);
  const auto direction = Of(model).lens->Unmap(params + kIntrinsics, m);
  const auto unit = direction ? UnitDirection(*direction) : std::nullopt;
  return unit ? std::optional(Ray{Eigen::Vector3d::Zero(), *unit}) : std::nullopt;
}

std::vector<StartCandidate> Start(const CameraModel& model, const StartProblem& problem) {
  return StartLens(model, problem, Of(model).starts);
}

CameraModel ModelOf(const FormulaModel& own) {
  CameraModel model{.name = own.name,
                    .source = own.source,
                    .params = own.params,
                    .config = CentralModel::kConfig,
                    .measured = CentralModel::kMeasured,
                    .context = CentralModel::kContext,
                    .example = own.example,
                    .example_config = CentralModel::kExampleConfig,
                    .example_size = {640, 480},
                    .centre = CentralModel::kCentre,
                    .plenoptic = CentralModel::kPlenoptic,
                    .functions = {.project = &ProjectPoint,
                                  .project_with_jacobian = &DifferentiatePoint,
                                  .unproject = &Unproject,
                                  .start = &Start,
                                  .misfit = &CentralModel::JudgeFit,
                                  .project_block = &ProjectBlock}};
  model.self = &own;
  model.formula = own.text;
  model.homogeneous = true;
  return model;
}

bool IsFormula(const CameraModel& model) { return model.functions.project == &ProjectPoint; }

// --- reading ---

constexpr std::array<std::string_view, 3> kForms{"map", "radius", "ray"};  // as in `Form`
constexpr std::array kReserved{"X", "Y", "Z", "theta", "r", "x", "y"};

// Calls `work` and puts the place of `node` before its message.
template <typename Work>
auto AtNode(const YamlNode& node, const Work& work) {
  try {
    return work();
  } catch (const Error& error) {
    node.Fail(error.what());
  }
}

void CheckName(const std::string& name, const Names& known, const YamlNode& node) {
  if (!IsName(name)) {
    node.Fail("is no name for a formula: letters, digits and '_', and no function");
  }
  const bool intrinsic =
      std::ranges::any_of(kIntrinsicParams, [&](const Param& param) { return param.name == name; });
  if (known.contains(name) || intrinsic || std::ranges::find(kReserved, name) != kReserved.end()) {
    node.Fail(fmt::format("'{}' has a meaning already; give it another name", name));
  }
}

class Reader {
 public:
  Reader(const YamlNode& root, FormulaModel* model) : root_(root), model_(*model) {}

  void Read() {
    constexpr size_t kLongest = 65536;
    if (root_.Dump().size() > kLongest) root_.Fail("is longer than 64 kB");
    root_.CheckKeys(Words("source params let map radius ray domain unmap example"));
    model_.source = root_.Has("source") ? root_.At("source").AsString() : "a formula";
    if (model_.source.empty()) root_.At("source").Fail("expected author and title");
    ReadForm();
    ReadParams();
    for (size_t i = 0; i < inputs_.size(); ++i) {
      names_[inputs_[i]] = nodes_.graph.Input(static_cast<int>(i));
    }
    ReadDefinitions();
    constexpr std::array<size_t, 3> kOutputs{2, 1, 3};  // as `kForms`
    nodes_.outputs = ReadList(root_.At(form_), kOutputs[static_cast<size_t>(nodes_.form)]);
    if (const auto domain = root_.Find("domain")) {
      for (const YamlNode& node : Listed(*domain)) nodes_.conditions.push_back(Parse(node, true));
    }
    ReadUnmap();
    ReadExample();
    MakeLens();
  }

 private:
  void ReadForm() {
    std::vector<std::string_view> found;
    for (const std::string_view form : kForms) {
      if (root_.Has(form)) found.push_back(form);
    }
    if (found.size() != 1) root_.Fail("expected one of the keys map, radius and ray");
    form_ = found[0];
    nodes_.form = static_cast<Form>(std::ranges::find(kForms, form_) - kForms.begin());
    if (nodes_.form == Form::kMap) inputs_ = {"X", "Y", "Z"};
    if (nodes_.form == Form::kRay) inputs_ = {"x", "y"};
    if (nodes_.form == Form::kRadius) inputs_ = {UsesRatio() ? "r" : "theta"};
    nodes_.of_angle = inputs_[0] == "theta";
  }
  // Whether the radius is a formula of r: one of theta does not have that name.
  [[nodiscard]] bool UsesRatio() const {
    for (const char* input : {"r", "theta"}) {
      std::vector<std::string> texts{root_.At("radius").AsString()};
      if (const auto let = root_.Find("let")) {
        for (const auto& [name, node] : let->Entries()) texts.push_back(node.AsString());
      }
      for (const std::string& text : texts) {
        if (HasWord(text, input)) return input == std::string_view("r");
      }
    }
    return false;
  }
  static bool HasWord(const std::string& text, std::string_view word) {
    const auto in_name = [](char c) {
      return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_';
    };
    for (size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) {
      const size_t end = at + word.size();
      if ((at == 0 || !in_name(text[at - 1])) && (end == text.size() || !in_name(text[end]))) {
        return true;
      }
    }
    return false;
  }

  void ReadParams() {
    model_.params.assign(kIntrinsicParams.begin(), kIntrinsicParams.end());
    model_.starts = {{}};
    const auto params = root_.Find("params");
    if (!params) return;
    const auto entries = params->Entries();
    constexpr size_t kMost = 64;
    if (entries.size() > kMost) params->Fail("has more than 64 parameters");
    model_.texts.reserve(2 * entries.size());  // the parameters refer to them
    for (const auto& [name, node] : entries) {
      CheckName(name, names_, node);
      const auto number = static_cast<int>(inputs_.size() + names_.size());
      names_[name] = nodes_.graph.Input(number);
      ReadParam(name, node);
    }
    nodes_.param_count = entries.size();
  }
  void ReadParam(const std::string& name, const YamlNode& node) {
    node.CheckKeys(Words("scale start unit bounds neutral"));
    Param param;
    param.scale = 1;
    model_.texts.push_back(name);
    param.name = model_.texts.back();
    model_.texts.push_back(node.Has("unit") ? node.At("unit").AsString() : "1");
    param.unit = model_.texts.back();
    if (param.unit.empty()) node.At("unit").Fail("expected a unit; 1 if there is none");
    if (node.Has("scale")) param.scale = node.At("scale").AsPositive();
    if (const auto bounds = node.Find("bounds")) {
      const std::vector<double> limits = bounds->AsNumbers(2);
      param.lower = limits[0];
      param.upper = limits[1];
      if (!(param.lower < param.upper)) bounds->Fail("expected [lower, upper]");
    }
    const auto within = [&](double value) { return value > param.lower && value < param.upper; };
    if (within(0)) param.neutral = 0;
    if (const auto neutral = node.Find("neutral")) param.neutral = neutral->AsNumber();
    std::vector<double> starts{param.neutral.value_or((param.lower + param.upper) / 2)};
    if (const auto start = node.Find("start")) {
      starts = start->IsSequence() ? start->AsNumbers(0) : std::vector{start->AsNumber()};
      if (!std::ranges::all_of(starts, within)) start->Fail("is not within the bounds");
    }
    constexpr size_t kMostStarts = 16;
    if (starts.empty() || model_.starts.size() * starts.size() > kMostStarts) {
      node.Fail("expected 1 to 16 combinations of start values");
    }
    if (!within(starts[0])) node.Fail("needs 'start', a value within its bounds");
    std::vector<std::vector<double>> all;
    for (const double start : starts) {
      for (std::vector<double> k : model_.starts) {
        k.push_back(start);
        all.push_back(std::move(k));
      }
    }
    model_.starts = std::move(all);
    model_.params.push_back(param);
  }

  void ReadDefinitions() {
    const auto let = root_.Find("let");
    if (!let) return;
    const auto entries = let->Entries();
    for (const auto& [name, node] : entries) {
      CheckName(name, names_, node);
      names_[name] = -1;
    }
    for (const auto& [name, node] : entries) names_[name] = Parse(node, false);
  }
  int Parse(const YamlNode& node, bool condition) {
    return AtNode(
        node, [&] { return formula::Parse(node.AsString(), names_, condition, &nodes_.graph); });
  }
  static std::vector<YamlNode> Listed(const YamlNode& node) {
    return node.IsSequence() ? node.Elements() : std::vector{node};
  }
  std::vector<int> ReadList(const YamlNode& node, size_t count) {
    const std::vector<YamlNode> list = Listed(node);
    if (list.size() != count) {
      node.Fail(fmt::format(
          "expected {} formula{}; one with commas stands in quotes", count, count == 1 ? "" : "s"));
    }
    std::vector<int> parsed;
    for (const YamlNode& element : list) parsed.push_back(Parse(element, false));
    return parsed;
  }
  void ReadUnmap() {
    const auto unmap = root_.Find("unmap");
    if (!unmap) return;
    if (nodes_.form != Form::kMap) unmap->Fail("belongs to 'map'; the others are solved");
    names_.clear();
    for (size_t i = 0; i < nodes_.param_count; ++i) {
      names_[std::string(model_.params[kIntrinsics + i].name)] =
          nodes_.graph.Input(static_cast<int>(3 + i));
    }
    names_["x"] = nodes_.graph.Input(0);
    names_["y"] = nodes_.graph.Input(1);
    nodes_.unmap = ReadList(*unmap, 3);
  }
  void ReadExample() {
    const size_t count = model_.params.size();
    model_.example = {400, 400, 319.5, 239.5};
    model_.example.insert(model_.example.end(), model_.starts[0].begin(), model_.starts[0].end());
    const auto example = root_.Find("example");
    if (!example) return;
    model_.example = example->AsNumbers(count);
    for (size_t i = 0; i < count; ++i) {
      const Param& param = model_.params[i];
      if (model_.example[i] > param.lower && model_.example[i] < param.upper) continue;
      example->Fail(fmt::format("{} = {} is not within its bounds", param.name, model_.example[i]));
    }
  }
  void MakeLens() {
    const YamlNode node = root_.At(form_);
    constexpr int kMostWithDerivatives = 40000;
    nodes_.graph.Limit(kMostWithDerivatives);
    const double* const k = model_.example.data() + kIntrinsics;
    const std::string defect = AtNode(node, [&] {
      std::string on_axis = DefectOnAxis(nodes_, k);
      if (!on_axis.empty()) return on_axis;
      model_.lens = formula::MakeLens(nodes_);
      return DefectAround(*model_.lens,
                          nodes_.form,
                          std::span(model_.params).subspan(kIntrinsics),
                          std::span(model_.example).subspan(kIntrinsics));
    });
    if (!defect.empty()) node.Fail(defect);
    model_.nodes = std::move(nodes_);
  }

  const YamlNode& root_;
  FormulaModel& model_;
  LensNodes nodes_;
  std::string_view form_;
  std::vector<std::string> inputs_;
  Names names_;
};

}  // namespace
}  // namespace formula

const CameraModel& AddFormulaModel(const std::string& name,
                                   const YamlNode& node,
                                   const std::filesystem::path& file) {
  constexpr size_t kLongestName = 64;
  if (name.empty() || name.size() > kLongestName ||
      name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789-") != std::string::npos) {
    node.Fail("the name of a model has only a to z, 0 to 9 and '-'");
  }
  auto own = std::make_shared<formula::FormulaModel>();
  own->name = name;
  own->text = node.Dump();
  own->file = file.string();
  const CameraModel* const known = FindModel(CameraModels(), name);
  if (known != nullptr && formula::IsFormula(*known)) {
    if (known->formula == own->text) return *known;
    node.Fail(fmt::format("{} has another formula of this name; rename one of them",
                          formula::Of(*known).file));
  }
  if (known != nullptr || name == kAuto) {
    node.Fail("is the name of a model of this program; give the formula another name");
  }
  formula::Reader(node, own.get()).Read();
  return AddCameraModel(formula::ModelOf(*own), own, own->file);
}

void CheckFormula(const YamlNode& node) {
  formula::FormulaModel model;
  formula::Reader(node, &model).Read();
}

std::string FormulaHeader(const CameraModel& model) {
  if (!formula::IsFormula(model)) {
    throw InputError("{} is made of no formula; its header is in models/", model.name);
  }
  const formula::FormulaModel& own = formula::Of(model);
  return formula::HeaderText(model, own.nodes, own.starts);
}

void AddFormulaModels(const std::filesystem::path& file) {
  const std::string text = ReadTextFile(file, InputLimit::kDocument);
  if (text.find("models") == std::string::npos) return;  // not parsed twice
  const auto models = YamlNode::Parse(text, file.string()).Find("models");
  if (!models) return;
  if (!models->IsSequence()) {
    for (const auto& [name, node] : models->Entries()) AddFormulaModel(name, node, file);
    return;
  }
  for (const YamlNode& node : models->Elements()) AddModelFile(PathBeside(file, node));
}

void AddModelFile(const std::filesystem::path& file) {
  const YamlNode root = YamlNode::ReadFile(file);
  root.CheckKeys({"plenocal", "models"});
  for (const auto& [name, node] : root.At("models").Entries()) {
    AddFormulaModel(name, node, file);
  }
}

}  // namespace plenocal
