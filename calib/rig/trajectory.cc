// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/trajectory.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/io/input_file.h"

namespace plenocal {
namespace {

// Files are printed with few digits: three suffice that lengths differ from 1 by less.
constexpr double kUnitTolerance = 1e-2;
// Seconds since 1970 stay below it for 1000 years, nanoseconds are above it after 100 s.
constexpr double kNanosecondsAbove = 1e11;
constexpr double kNanosecond = 1e-9;

bool IsBlank(char c) { return c == ' ' || c == '\t' || c == '\r'; }

/// The lines of a file that hold numbers.
class NumberLines {
 public:
  NumberLines(std::string path, std::string_view text) : path_(std::move(path)), text_(text) {}

  /// Goes to the next line; false at the end.
  bool Next() {
    while (!text_.empty()) {
      const size_t newline = text_.find('\n');
      line_ = text_.substr(0, newline);
      text_.remove_prefix(newline == std::string_view::npos ? text_.size() : newline + 1);
      ++number_;
      if (number_ == 1 && line_.starts_with("\xEF\xBB\xBF")) line_.remove_prefix(3);
      while (!line_.empty() && IsBlank(line_.front())) line_.remove_prefix(1);
      while (!line_.empty() && IsBlank(line_.back())) line_.remove_suffix(1);
      if (line_.empty()) continue;
      if (line_.front() == '#' || IsHeader()) {
        if (!seen_ && HasCommas()) header_ = line_;
        continue;
      }
      seen_ = true;
      return true;
    }
    return false;
  }

  [[nodiscard]] bool HasCommas() const { return line_.find(',') != std::string_view::npos; }

  /// The names of the columns before the first numbers, in lower case without units; none where
  /// there are none.
  [[nodiscard]] std::vector<std::string> Columns() const {
    std::vector<std::string> columns;
    for (std::string_view rest = header_; !rest.empty();) {
      std::string name(rest.substr(0, rest.find(',')));
      rest.remove_prefix(std::min(rest.size(), name.size() + 1));
      name.resize(std::min(name.size(), name.find('[')));
      std::erase_if(name, [](char c) { return IsBlank(c) || c == '#'; });
      columns.push_back(LowerCase(name));
    }
    return columns;
  }

  /// Number of numbers in the line.
  [[nodiscard]] size_t Count() const {
    size_t count = 0;
    bool inside = false;
    for (const char c : line_) {
      const bool separates = IsBlank(c) || c == ',';
      if (!separates && !inside) ++count;
      inside = !separates;
    }
    return count;
  }

  enum class Rest { kNone, kIgnored };
  /// The first `count` numbers of the line. Fails when more follow, unless the rest is ignored.
  void Read(size_t count, Rest rest, double* values) const {
    const char* at = line_.data();
    const char* const end = at + line_.size();
    for (size_t i = 0; i < count; ++i) {
      while (at != end && (IsBlank(*at) || *at == ',')) ++at;
      if (at == end) Fail(fmt::format("expected {} numbers, found {}", count, i));
      if (*at == '+') ++at;
      const auto [after, error] = std::from_chars(at, end, values[i]);
      if (error != std::errc() || (after != end && !IsBlank(*after) && *after != ',')) {
        const char* word = at;
        while (word != end && !IsBlank(*word) && *word != ',') ++word;
        Fail(fmt::format("expected a number, found '{}'", std::string_view(at, word - at)));
      }
      if (!std::isfinite(values[i])) {
        Fail(fmt::format(
            "number {} is {}; a pose that is not known must be left out", i + 1, values[i]));
      }
      at = after;
    }
    if (rest == Rest::kNone && at != end) {
      Fail(fmt::format("expected {} numbers, found {}", count, Count()));
    }
  }

  [[noreturn]] void Fail(const std::string& message) const {
    throw InputError("{}:{}: {}", path_, number_, message);
  }

 private:
  // Words before the first numbers name the columns; "nan" and "inf" are numbers that are wrong.
  [[nodiscard]] bool IsHeader() const {
    if (seen_ || std::isalpha(static_cast<unsigned char>(line_.front())) == 0) return false;
    double value = 0;
    return std::from_chars(line_.data(), line_.data() + line_.size(), value).ec != std::errc();
  }

  std::string path_;
  std::string_view text_;
  std::string_view line_;
  std::string_view header_;
  int number_ = 0;
  bool seen_ = false;
};

enum class Form { kTum, kEuroc, kKitti };

/// The form of a table between commas: that of EuRoC unless its columns are named in another order.
Form FormOfTable(const NumberLines& lines) {
  const std::vector<std::string> columns = lines.Columns();
  if (!columns.empty() && columns[0] == "frame") {
    lines.Fail("the first column has frames; write the time of each pose in their place");
  }
  const auto component = [&](char name) {
    return std::ranges::find_if(columns, [&](const std::string& column) {
      return column.starts_with('q') && column.ends_with(name);
    });
  };
  const auto w = component('w');
  return w != columns.end() && component('x') < w ? Form::kTum : Form::kEuroc;
}

Form FormOf(const NumberLines& lines) {
  const size_t count = lines.Count();
  if (lines.HasCommas() && count >= 8) return FormOfTable(lines);
  if (count == 8) return Form::kTum;
  if (count == 12) return Form::kKitti;
  lines.Fail(
      fmt::format("{} numbers are no pose; expected 't x y z qx qy qz qw' (TUM, ORB-SLAM), "
                  "'t,x,y,z,qw,qx,qy,qz' (EuRoC) or the 12 numbers of a 3 x 4 matrix (KITTI)",
                  count));
}

/// Fails when time goes back.
void CheckOrder(const NumberLines& lines, double before, double time) {
  if (time >= before) return;
  lines.Fail(fmt::format("time {:.9f} comes after {:.9f}; sort the poses by time", time, before));
}

std::vector<double> ReadTimes(const std::filesystem::path& path) {
  const std::string text = ReadTextFile(path);
  NumberLines lines(path.string(), text);
  std::vector<double> times;
  while (lines.Next()) {
    double time = 0;
    lines.Read(1, NumberLines::Rest::kNone, &time);
    if (!times.empty()) CheckOrder(lines, times.back(), time);
    times.push_back(time);
  }
  return times;
}

/// A pose T_world_camera.
struct Pose {
  Eigen::Vector3d position;
  Eigen::Quaterniond orientation;
};

Pose FromQuaternion(const NumberLines& lines, const double* p, const Eigen::Quaterniond& q) {
  const double norm = q.norm();
  if (!(std::abs(norm - 1) < kUnitTolerance)) {
    lines.Fail(fmt::format("the quaternion has length {:.6g}, not 1", norm));
  }
  return {Eigen::Vector3d(p[0], p[1], p[2]), Eigen::Quaterniond(q.coeffs() / norm)};
}

Pose FromMatrix(const NumberLines& lines, const double* values) {
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> T(values);
  const Eigen::Matrix3d R = T.leftCols<3>();
  const double off = (R * R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(off < kUnitTolerance && R.determinant() > 0)) {
    lines.Fail("the left 3 x 3 numbers are no rotation matrix");
  }
  return {T.col(3), Eigen::Quaterniond(R).normalized()};
}

/// Adds a pose. Fails when time goes back; of poses at one time only the first is kept.
void Append(const NumberLines& lines, double time, const Pose& pose, Trajectory* trajectory) {
  if (!trajectory->times.empty()) {
    const double before = trajectory->times.back();
    CheckOrder(lines, before, time);
    if (time == before) {
      ++trajectory->repeated;
      return;
    }
  }
  trajectory->times.push_back(time);
  trajectory->positions.push_back(pose.position);
  trajectory->orientations.push_back(pose.orientation);
}

/// Reads lines of 3 x 4 matrices from the current one on. `times_path` may be empty.
void ReadKitti(const std::filesystem::path& times_path,
               NumberLines* lines,
               Trajectory* trajectory) {
  std::optional<std::vector<double>> times;
  if (!times_path.empty()) times = ReadTimes(times_path);
  trajectory->has_times = times.has_value();
  size_t row = 0;
  do {
    std::array<double, 12> values{};
    lines->Read(values.size(), NumberLines::Rest::kNone, values.data());
    const Pose pose = FromMatrix(*lines, values.data());
    if (!times) {
      Append(*lines, static_cast<double>(row), pose, trajectory);
    } else if (row < times->size()) {
      Append(*lines, (*times)[row], pose, trajectory);
    }
    ++row;
  } while (lines->Next());
  if (times && times->size() != row) {
    throw InputError("{}: has {} times, but {} has {} poses",
                     times_path.string(),
                     times->size(),
                     trajectory->path,
                     row);
  }
}

/// Reads lines of time, position and quaternion from the current one on.
void ReadQuaternions(Form form, NumberLines* lines, Trajectory* trajectory) {
  const bool is_euroc = form == Form::kEuroc;
  const auto rest = lines->HasCommas() ? NumberLines::Rest::kIgnored : NumberLines::Rest::kNone;
  std::optional<double> unit;  // s, of the times
  do {
    std::array<double, 8> v{};
    lines->Read(v.size(), rest, v.data());
    const Eigen::Quaterniond q = is_euroc ? Eigen::Quaterniond(v[4], v[5], v[6], v[7])
                                          : Eigen::Quaterniond(v[7], v[4], v[5], v[6]);
    if (!unit) unit = is_euroc || v[0] > kNanosecondsAbove ? kNanosecond : 1;
    if (is_euroc && v[0] != std::floor(v[0])) {
      lines->Fail(fmt::format(
          "time {} is no whole number of nanoseconds (EuRoC); for seconds write "
          "'t x y z qx qy qz qw' between blanks, or name the columns timestamp,x,y,z,qx,qy,qz,qw",
          v[0]));
    }
    Append(*lines, v[0] * *unit, FromQuaternion(*lines, &v[1], q), trajectory);
  } while (lines->Next());
}

}  // namespace

Trajectory ReadTrajectory(const std::filesystem::path& path,
                          const std::filesystem::path& kitti_times) {
  const std::string text = ReadTextFile(path);
  NumberLines lines(path.string(), text);
  Trajectory trajectory;
  trajectory.path = path.string();
  if (!lines.Next()) {
    throw InputError("{}: holds no poses", path.string());
  }
  const Form form = FormOf(lines);
  if (form == Form::kKitti) {
    ReadKitti(kitti_times, &lines, &trajectory);
  } else {
    ReadQuaternions(form, &lines, &trajectory);
  }
  return trajectory;
}

}  // namespace plenocal
