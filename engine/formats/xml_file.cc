// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/xml_file.h"

#include <charconv>
#include <cmath>

#include "calib/base/format_error.h"
#include "calib/io/input_file.h"

namespace plenocal {

XmlFile::XmlFile(const std::filesystem::path& path) : where_(path.string()) {
  const pugi::xml_parse_result parsed =
      document_.load_string(ReadTextFile(path, InputLimit::kDocument).c_str());
  if (!parsed) Fail(fmt::format("not valid XML: {}", parsed.description()));
}

double XmlFile::Number(std::string_view text, std::string_view element) const {
  double value = 0;
  const char* const end = text.data() + text.size();
  const auto [after, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || after != end || !std::isfinite(value)) {
    Fail(fmt::format("{}: expected a number, found '{}'", element, text));
  }
  return value;
}

int XmlFile::Pixels(std::string_view text, std::string_view element) const {
  constexpr double kMost = 1e6;  // no image has more pixels in a row
  const double value = Number(text, element);
  if (!(value >= 1 && value < kMost)) {
    Fail(fmt::format("{}: expected a number of pixels, found '{}'", element, text));
  }
  return static_cast<int>(value);
}

void XmlFile::Fail(std::string_view message) const { throw InputError("{}: {}", where_, message); }

}  // namespace plenocal
