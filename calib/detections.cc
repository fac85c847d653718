// SPDX-License-Identifier: Apache-2.0
#include "calib/detections.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <numeric>
#include <unordered_map>
#include <utility>

#include "calib/error.h"
#include "calib/number_text.h"
#include "calib/text_file.h"

namespace plenocal {
namespace {

// Enough that exact (simulated) observations pass through a file without visible loss.
constexpr int kCoordinateDecimals = 8;

std::string_view Trim(std::string_view text) {
  const size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

void Split(std::string_view line, std::vector<std::string_view>* fields) {
  fields->clear();
  for (size_t begin = 0;;) {
    const size_t comma = line.find(',', begin);
    fields->push_back(Trim(line.substr(begin, comma - begin)));
    if (comma == std::string_view::npos) return;
    begin = comma + 1;
  }
}

// Column of what an error that all observations share moves a coordinate by; counted from 1.
std::string SharedName(std::string_view coordinate, size_t error) {
  return fmt::format("{}_shared_{}", coordinate, error);
}

class DetectionReader {
 public:
  DetectionReader(const std::filesystem::path& path, const CameraModel& model)
      : path_(path.string()), model_(model) {}

  std::vector<View> Read(std::string_view text) {
    bool has_header = false;
    while (!text.empty()) {
      const size_t newline = text.find('\n');
      std::string_view line = text.substr(0, newline);
      text.remove_prefix(newline == std::string_view::npos ? text.size() : newline + 1);
      ++line_;
      if (line_ == 1 && line.starts_with("\xEF\xBB\xBF")) line.remove_prefix(3);
      line = Trim(line);
      if (line.empty() || line.front() == '#') continue;
      Split(line, &fields_);
      if (has_header) {
        ReadRow();
      } else {
        ReadHeader();
        has_header = true;
      }
    }
    if (!has_header) Fail("expected a header line such as 'frame,marker,x,y,sigma', found nothing");
    CheckUnique();
    return std::move(views_);
  }

 private:
  [[noreturn]] void Fail(const std::string& message) const {
    throw Error(ErrorKind::kInput, fmt::format("{}:{}: {}", path_, std::max(line_, 1), message));
  }

  int FindColumn(std::string_view name) const {
    const auto found = std::find(fields_.begin(), fields_.end(), name);
    return found == fields_.end() ? -1 : static_cast<int>(found - fields_.begin());
  }

  void ReadHeader() {
    const auto require = [&](std::string_view name) {
      const int column = FindColumn(name);
      if (std::count(fields_.begin(), fields_.end(), name) > 1) {
        Fail(fmt::format("column '{}' stands in the header twice; remove one", name));
      }
      if (column < 0) {
        Fail(fmt::format("column '{}' is missing; model {} needs frame,marker,{}{}{}[,sigma]",
                         name,
                         model_.name,
                         fmt::join(model_.measured, ","),
                         model_.context.empty() ? "" : ",",
                         fmt::join(model_.context, ",")));
      }
      return static_cast<size_t>(column);
    };
    column_count_ = fields_.size();
    frame_column_ = require("frame");
    marker_column_ = require("marker");
    for (const std::string_view name : model_.measured) value_columns_.push_back(require(name));
    for (const std::string_view name : model_.context) value_columns_.push_back(require(name));
    sigma_column_ = FindColumn("sigma");
    for (size_t error = 1; FindColumn(SharedName(model_.measured[0], error)) >= 0; ++error) {
      for (const std::string_view name : model_.measured) {
        const std::string column = SharedName(name, error);
        shared_columns_.emplace_back(column, require(column));
      }
    }
  }

  double Number(size_t column, std::string_view what) const {
    const std::string_view text = fields_[column];
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) {
      Fail(fmt::format("{}: expected a number, found '{}'", what, text));
    }
    return value;
  }

  void ReadRow() {
    if (fields_.size() != column_count_) {
      Fail(fmt::format("expected {} columns as in the header, found {} (is the file truncated?)",
                       column_count_,
                       fields_.size()));
    }
    Observation observation;
    const std::string_view marker = fields_[marker_column_];
    const auto [end, error] =
        std::from_chars(marker.data(), marker.data() + marker.size(), observation.marker);
    if (error != std::errc() || end != marker.data() + marker.size()) {
      Fail(fmt::format("marker: expected a whole number, found '{}'", marker));
    }
    for (size_t i = 0; i < value_columns_.size(); ++i) {
      const std::string_view name = i < model_.measured.size()
                                        ? model_.measured[i]
                                        : model_.context[i - model_.measured.size()];
      observation.values[i] = Number(value_columns_[i], name);
    }
    if (sigma_column_ >= 0 && !fields_[static_cast<size_t>(sigma_column_)].empty()) {
      observation.sigma = Number(static_cast<size_t>(sigma_column_), "sigma");
      if (!(observation.sigma > 0)) {
        Fail(fmt::format("sigma: expected a positive number, found '{}'",
                         fields_[static_cast<size_t>(sigma_column_)]));
      }
    }
    const std::string_view frame = fields_[frame_column_];
    if (frame.empty()) Fail("frame: expected a name, found nothing");
    // Rows of one frame usually follow each other.
    if (views_.empty() || views_[last_view_].frame != frame) {
      const auto [place, is_new] = view_of_frame_.emplace(std::string(frame), views_.size());
      if (is_new) {
        views_.push_back({std::string(frame), {}});
        lines_.emplace_back();
      }
      last_view_ = place->second;
    }
    views_[last_view_].observations.push_back(observation);
    if (!shared_columns_.empty()) views_[last_view_].shared_errors.push_back(SharedErrors());
    lines_[last_view_].push_back(line_);
  }

  // Of the row, as `View` has them.
  std::vector<double> SharedErrors() const {
    const size_t dimension = model_.measured.size(), count = shared_columns_.size() / dimension;
    std::vector<double> errors(shared_columns_.size());
    for (size_t error = 0; error < count; ++error) {
      for (size_t i = 0; i < dimension; ++i) {
        const auto& [name, column] = shared_columns_[error * dimension + i];
        errors[i * count + error] = Number(column, name);
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
        line_ = lines_[v][*std::next(twin)];
        Fail(fmt::format("frame '{}' has marker {} in line {} already; keep one of the two rows",
                         views_[v].frame,
                         seen[*twin].marker,
                         lines_[v][*twin]));
      }
    }
  }

  std::string path_;
  const CameraModel& model_;
  int line_ = 0;
  std::vector<std::string_view> fields_;
  size_t column_count_ = 0, frame_column_ = 0, marker_column_ = 0;
  std::vector<size_t> value_columns_;
  std::vector<std::pair<std::string, size_t>> shared_columns_;  // error by error
  int sigma_column_ = -1;
  std::vector<View> views_;
  std::vector<std::vector<int>> lines_;  // of the observations of `views_`
  std::unordered_map<std::string, size_t> view_of_frame_;
  size_t last_view_ = 0;
};

}  // namespace

std::vector<View> ReadDetections(const std::filesystem::path& path, const CameraModel& model) {
  return DetectionReader(path, model).Read(ReadTextFile(path));
}

std::string DetectionsCsv(std::span<const View> views, const CameraModel& model) {
  std::string text = "frame,marker";
  for (const std::string_view name : model.measured) text.append(",").append(name);
  for (const std::string_view name : model.context) text.append(",").append(name);
  text += ",sigma";
  size_t errors = 0;
  for (const View& view : views) {
    if (!view.shared_errors.empty()) {
      errors = view.shared_errors[0].size() / model.measured.size();
    }
  }
  for (size_t error = 0; error < errors; ++error) {
    for (const std::string_view name : model.measured) text += "," + SharedName(name, error + 1);
  }
  text += '\n';
  for (const View& view : views) {
    for (size_t row = 0; row < view.observations.size(); ++row) {
      const Observation& observation = view.observations[row];
      text.append(view.frame).append(",").append(std::to_string(observation.marker));
      for (size_t i = 0; i < model.measured.size() + model.context.size(); ++i) {
        text += ',';
        AppendFixed(observation.values[i], kCoordinateDecimals, &text);
      }
      text += ',';
      if (observation.sigma > 0) AppendFixed(observation.sigma, kCoordinateDecimals, &text);
      for (size_t error = 0; error < errors; ++error) {
        for (size_t i = 0; i < model.measured.size(); ++i) {
          text += ',';
          const double moved =
              view.shared_errors.empty() ? 0 : view.shared_errors[row][i * errors + error];
          AppendFixed(moved, kCoordinateDecimals, &text);
        }
      }
      text += '\n';
    }
  }
  return text;
}

}  // namespace plenocal
