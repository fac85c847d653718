// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/frames/times.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>

#include "calib/base/format_error.h"
#include "calib/io/csv.h"
#include "calib/io/input_file.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

// Seconds since 1970 stay below it for 1000 years, nanoseconds are above it after 100 s.
constexpr double kLeastNanoseconds = 1e11;
constexpr double kOneNanosecond = 1e-9;  // s

enum class TimesForm { kIdTimeExposure, kTime, kTimeFile };

TimesForm FormOfRow(std::string_view row) {
  if (row.find(',') != std::string_view::npos) return TimesForm::kTimeFile;
  const size_t blank = row.find_first_of(" \t");
  const bool more =
      blank != std::string_view::npos && row.find_first_not_of(" \t\r", blank) != row.npos;
  return more ? TimesForm::kIdTimeExposure : TimesForm::kTime;
}

CsvReader::GivenColumns ColumnsOfForm(TimesForm form) {
  switch (form) {
    case TimesForm::kTimeFile:
      return {.names = {"time", "file"}};
    case TimesForm::kTime:
      return {.names = {"time"}};
    case TimesForm::kIdTimeExposure:
      return {.names = {"id", "time", "exposure"}, .optional = 1};
  }
  return {};
}

double MillisecondsIn(ExposureUnit unit) {
  constexpr double kSecond = 1000, kMicrosecond = 1e-3;
  if (unit == ExposureUnit::kSeconds) return kSecond;
  return unit == ExposureUnit::kMicroseconds ? kMicrosecond : 1;
}

// Nothing where the cell is empty or 0: the camera did not give it.
std::optional<double> ExposureIn(const CsvReader& table, ExposureUnit unit) {
  const std::optional<size_t> column = table.Find("exposure");
  const std::optional<double> value = column ? table.NumberIfAny(*column) : std::nullopt;
  if (!value || *value == 0) return std::nullopt;
  if (*value < 0) {
    table.FailAt(*column, fmt::format("expected a positive number, found '{}'", *value));
  }
  return *value * MillisecondsIn(unit);
}

}  // namespace

std::string_view FirstRow(std::string_view text, int skip) {
  for (int line = 0; !text.empty(); ++line) {
    const std::string_view row = text.substr(0, text.find('\n'));
    const size_t first = row.find_first_not_of(" \t\r");
    const bool filled = first != std::string_view::npos && row[first] != '#';
    if (line >= skip && filled) return row.substr(first);
    text.remove_prefix(std::min(row.size() + 1, text.size()));
  }
  return {};
}

ImageTimes ReadImageTimes(const fs::path& path, ExposureUnit unit) {
  const std::string text = ReadTextFile(path);
  const TimesForm form = FormOfRow(FirstRow(text, 0));
  CsvReader table(text,
                  path.string(),
                  form == TimesForm::kTimeFile ? CsvSyntax::kCsv : CsvSyntax::kVnlog,
                  ColumnsOfForm(form));
  ImageTimes times{.path = path, .has_ids = form != TimesForm::kTime, .rows = {}};
  const size_t column = table.Column("time");
  std::optional<double> seconds;  // in the unit of the file's times
  while (table.Next()) {
    ImageTime row{.id = {}, .time = table.Number(column), .exposure = {}, .line = table.Line()};
    if (!seconds) {
      const bool nanoseconds = form == TimesForm::kTimeFile || row.time > kLeastNanoseconds;
      seconds = nanoseconds ? kOneNanosecond : 1;
    }
    row.time *= *seconds;
    row.exposure = ExposureIn(table, unit);
    if (form == TimesForm::kIdTimeExposure) row.id = table.Text(table.Column("id"));
    if (form == TimesForm::kTimeFile) row.id = table.Text(table.Column("file"));
    if (!times.rows.empty() && row.time <= times.rows.back().time) {
      table.FailAt(column,
                   fmt::format("the time {:.9f} s comes after {:.9f} s in line {}; times must "
                               "increase: sort the lines, or remove the one that is wrong",
                               row.time,
                               times.rows.back().time,
                               times.rows.back().line));
    }
    times.rows.push_back(std::move(row));
  }
  if (times.rows.empty()) {
    throw InputError(
        "{}: holds no times; expected lines 'id time exposure' (TUM), 'time' "
        "(KITTI) or 'time,file' (EuRoC)",
        path.string());
  }
  return times;
}

std::map<std::pair<std::string, std::string>, double> ReadExposureTable(const fs::path& path) {
  const std::string text = ReadTextFile(path);
  CsvReader table(text, path.string());
  const size_t frame = table.Column("frame"), camera = table.Column("camera");
  const size_t exposure = table.Column("exposure_ms");
  std::map<std::pair<std::string, std::string>, double> exposures;
  while (table.Next()) {
    const std::optional<double> value = table.NumberIfAny(exposure);
    if (!value) continue;
    if (*value <= 0) {
      table.FailAt(exposure, fmt::format("expected a positive number, found '{}'", *value));
    }
    if (!exposures.emplace(std::pair(table.Text(camera), table.Text(frame)), *value).second) {
      table.Fail(
          fmt::format("image '{}' of camera '{}' has an exposure already; remove one of them",
                      table.Text(frame),
                      table.Text(camera)));
    }
  }
  return exposures;
}

}  // namespace plenocal
