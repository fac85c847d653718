// SPDX-License-Identifier: Apache-2.0
//
// Names and other text from outside as parts of messages and of result files.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace plenocal {

/// `text` with control characters and what is not UTF-8 as escapes ("\x1b"), for messages: it can
/// neither steer a terminal nor break a line. `kept`: control characters that stay.
std::string Escaped(std::string_view text, std::string_view kept = {});

/// `text` in double quotes as YAML 1.1, YAML 1.2 and JSON read it; bytes that are not UTF-8 become
/// U+FFFD.
std::string YamlQuoted(std::string_view text);
/// `text` as a plain scalar where every reader of YAML takes it for text, otherwise `YamlQuoted`.
std::string YamlText(std::string_view text);

/// `text` as a cell of a CSV file (RFC 4180), in quotes where it needs them.
std::string CsvCell(std::string_view text);

/// The defect of the name of a camera, which becomes a key and part of file names
/// (docs/formats.md): "has a '/'; use letters, digits, '_' and '-'"; nothing when it may be used.
std::optional<std::string> CameraNameDefect(std::string_view name);
/// The defect of the name of a frame, which becomes a cell and part of file names.
std::optional<std::string> FrameNameDefect(std::string_view name);

}  // namespace plenocal
