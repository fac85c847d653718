// SPDX-License-Identifier: Apache-2.0
//
// XML files of other tools (LiFCal, Metashape).
#pragma once

#include <filesystem>
#include <pugixml.hpp>
#include <string>
#include <string_view>

namespace plenocal {

/// A parsed file. All members throw `Error` of kind kInput with the file.
class XmlFile {
 public:
  explicit XmlFile(const std::filesystem::path& path);

  [[nodiscard]] const pugi::xml_document& Document() const { return document_; }
  /// `text` as a finite number; `element` for the message.
  [[nodiscard]] double Number(std::string_view text, std::string_view element) const;
  /// The same as a number of pixels.
  [[nodiscard]] int Pixels(std::string_view text, std::string_view element) const;
  [[noreturn]] void Fail(std::string_view message) const;

 private:
  std::string where_;
  pugi::xml_document document_;
};

}  // namespace plenocal
