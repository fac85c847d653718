// SPDX-License-Identifier: Apache-2.0
#include "calib/files/detections.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <numeric>
#include <optional>
#include <unordered_map>
#include <utility>

#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/io/csv.h"

namespace plenocal {
namespace {

// Enough that exact (simulated) observations pass through a file without visible loss.
constexpr int kCoordinateDecimals = 8;

// Column of what an error that all observations share moves a coordinate by; counted from 1.
std::string SharedName(std::string_view coordinate, size_t error) {
  return fmt::format("{}_shared_{}", coordinate, error);
}

std::string ColumnsOf(const CameraModel& model) {
  return fmt::format("frame,marker,{}{}{}",
                     fmt::join(model.measured, ","),
                     model.context.empty() ? "" : ",",
                     fmt::join(model.context, ","));
}

class DetectionReader {
 public:
  DetectionReader(const std::filesystem::path& path, const CameraModel& model)
      : table_(path, CsvSyntax::kCsv, {}, ColumnsOf(model)), model_(model) {}

  std::vector<View> Read() {
    FindColumns();
    while (table_.Next()) ReadRow();
    CheckUnique();
    for (View& view : views_) view.observations.shrink_to_fit();
    return std::move(views_);
  }

 private:
  size_t Require(std::string_view name) const {
    if (const std::optional<size_t> column = table_.Find(name)) return *column;
    table_.Fail(fmt::format(
        "column '{}' is missing; model {} needs {}[,sigma]", name, model_.name, ColumnsOf(model_)));
  }

  void FindColumns() {
    frame_column_ = Require("frame");
    marker_column_ = Require("marker");
    for (const std::string_view name : model_.measured) value_columns_.push_back(Require(name));
    for (const std::string_view name : model_.context) value_columns_.push_back(Require(name));
    for (const std::string_view name : model_.optional_context) {
      optional_columns_.push_back(table_.Find(name));
    }
    sigma_column_ = table_.Find("sigma");
    for (size_t error = 1; table_.Find(SharedName(model_.measured[0], error)); ++error) {
      for (const std::string_view name : model_.measured) {
        shared_columns_.push_back(Require(SharedName(name, error)));
      }
    }
  }

  void ReadRow() {
    Observation observation;
    observation.marker = table_.Integer(marker_column_);
    for (size_t i = 0; i < value_columns_.size(); ++i) {
      observation.values[i] = table_.Number(value_columns_[i]);
    }
    for (size_t i = 0; i < optional_columns_.size(); ++i) {
      if (!optional_columns_[i]) continue;
      observation.values[value_columns_.size() + i] = table_.Number(*optional_columns_[i]);
    }
    if (const auto sigma = sigma_column_ ? table_.NumberIfAny(*sigma_column_) : std::nullopt) {
      observation.detector_sigma = *sigma;
      if (!(*sigma > 0 && std::isnormal(*sigma * *sigma))) {
        table_.FailAt(*sigma_column_,
                      fmt::format("expected a positive number from 1e-150 to 1e150, found '{}'",
                                  table_.Text(*sigma_column_)));
      }
    }
    const std::string_view frame = table_.Text(frame_column_);
    // Rows of one frame usually follow each other.
    if (views_.empty() || views_[last_view_].frame != frame) {
      if (const auto defect = FrameNameDefect(frame)) {
        table_.FailAt(frame_column_, "this frame's name " + *defect);
      }
      const auto [place, is_new] = view_of_frame_.emplace(std::string(frame), views_.size());
      if (is_new) {
        views_.push_back({std::string(frame), {}});
        lines_.emplace_back();
      }
      last_view_ = place->second;
    }
    views_[last_view_].observations.push_back(observation);
    if (!shared_columns_.empty()) views_[last_view_].by_nuisance.push_back(SharedErrors());
    lines_[last_view_].push_back(table_.Line());
  }

  // The shared errors of the row, as `View` has them.
  std::vector<double> SharedErrors() const {
    const size_t dimension = model_.measured.size(), count = shared_columns_.size() / dimension;
    std::vector<double> errors(shared_columns_.size());
    for (size_t error = 0; error < count; ++error) {
      for (size_t i = 0; i < dimension; ++i) {
        errors[i * count + error] = table_.Number(shared_columns_[error * dimension + i]);
      }
    }
    return errors;
  }

  // The same marker through the same micro lens can be seen once.
  void CheckUnique() {
    const size_t first = model_.measured.size(), last = first + model_.context.size();
    const auto key_less = [&](const Observation& a, const Observation& b) {
      if (a.marker != b.marker) return a.marker < b.marker;
      return std::lexicographical_compare(a.values.begin() + first,
                                          a.values.begin() + last,
                                          b.values.begin() + first,
                                          b.values.begin() + last);
    };
    for (size_t v = 0; v < views_.size(); ++v) {
      const std::vector<Observation>& seen = views_[v].observations;
      std::vector<size_t> order(seen.size());
      std::iota(order.begin(), order.end(), size_t{0});
      // Stable, so that of two rows the one further down is called the second.
      std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
        return key_less(seen[a], seen[b]);
      });
      const auto twin = std::adjacent_find(order.begin(), order.end(), [&](size_t a, size_t b) {
        return !key_less(seen[a], seen[b]);
      });
      if (twin != order.end()) {
        table_.FailAtLine(
            lines_[v][*std::next(twin)],
            fmt::format("frame '{}' has marker {} in line {} already; keep one of the two rows",
                        views_[v].frame,
                        seen[*twin].marker,
                        lines_[v][*twin]));
      }
    }
  }

  CsvReader table_;
  const CameraModel& model_;
  size_t frame_column_ = 0, marker_column_ = 0;
  std::vector<size_t> value_columns_;  // measured, then context
  std::vector<std::optional<size_t>> optional_columns_;
  std::vector<size_t> shared_columns_;  // error by error
  std::optional<size_t> sigma_column_;
  std::vector<View> views_;
  std::vector<std::vector<int>> lines_;  // of the observations of `views_`
  std::unordered_map<std::string, size_t> view_of_frame_;
  size_t last_view_ = 0;
};

bool HasOptionalContext(std::span<const View> views, const CameraModel& model) {
  const size_t first = model.measured.size() + model.context.size();
  for (const View& view : views) {
    for (const Observation& seen : view.observations) {
      for (size_t i = 0; i < model.optional_context.size(); ++i) {
        if (seen.values[first + i] != 0) return true;
      }
    }
  }
  return false;
}

}  // namespace

std::vector<View> ReadDetections(const std::filesystem::path& path, const CameraModel& model) {
  return DetectionReader(path, model).Read();
}

std::string DetectionsCsv(std::span<const View> views, const CameraModel& model) {
  std::string text = "frame,marker";
  for (const std::string_view name : model.measured) text.append(",").append(name);
  for (const std::string_view name : model.context) text.append(",").append(name);
  text += ",sigma";
  const bool has_optional = HasOptionalContext(views, model);
  if (has_optional) {
    for (const std::string_view name : model.optional_context) text.append(",").append(name);
  }
  size_t errors = 0;
  for (const View& view : views) {
    if (!view.by_nuisance.empty()) {
      errors = view.by_nuisance[0].size() / model.measured.size();
    }
  }
  for (size_t error = 0; error < errors; ++error) {
    for (const std::string_view name : model.measured) {
      text.append(",").append(SharedName(name, error + 1));
    }
  }
  text += '\n';
  for (const View& view : views) {
    for (size_t row = 0; row < view.observations.size(); ++row) {
      const Observation& observation = view.observations[row];
      text.append(CsvCell(view.frame)).append(",").append(std::to_string(observation.marker));
      for (size_t i = 0; i < model.measured.size() + model.context.size(); ++i) {
        text += ',';
        AppendFixed(observation.values[i], kCoordinateDecimals, &text);
      }
      text += ',';
      if (observation.detector_sigma > 0) {
        AppendFixed(observation.detector_sigma, kCoordinateDecimals, &text);
      }
      for (size_t i = 0; has_optional && i < model.optional_context.size(); ++i) {
        text += ',';
        AppendFixed(observation.values[model.measured.size() + model.context.size() + i],
                    kCoordinateDecimals,
                    &text);
      }
      for (size_t error = 0; error < errors; ++error) {
        for (size_t i = 0; i < model.measured.size(); ++i) {
          text += ',';
          const double moved =
              view.by_nuisance.empty() ? 0 : view.by_nuisance[row][i * errors + error];
          AppendFixed(moved, kCoordinateDecimals, &text);
        }
      }
      text += '\n';
    }
  }
  return text;
}

std::string DetectionsName(const std::string& camera) {
  return fmt::format("detections_{}.csv", camera);
}

}  // namespace plenocal
