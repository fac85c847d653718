// SPDX-License-Identifier: Apache-2.0
//
// Decides which requests the workbench answers (docs/workbench.md, "Security").
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace plenocal::workbench {

/// A request as its handler sees it.
struct Request {
  std::string method;             ///< "GET"
  std::vector<std::string> path;  ///< decoded parts: {"api", "runs", "3"}
  std::map<std::string, std::string> query;
  std::map<std::string, std::string> headers;  ///< names in lower case
  std::string body;

  [[nodiscard]] std::string Header(const std::string& name) const;
  [[nodiscard]] std::string Query(const std::string& name) const;
};

struct Answer {
  int status = 200;
  std::string type = "application/json";
  std::string body = {};
  std::map<std::string, std::string> headers = {};
};

/// {"error": {"what": ..., "remedy": ...}}
Answer ErrorAnswer(int status, const std::string& what, const std::string& remedy = {});

/// Path and query of a request's target, decoded; nothing for one that is longer than 4 kB, does
/// not begin with '/', or has a part that is "..", or with '/', '\' or a control character in it.
struct Address {
  std::vector<std::string> path;
  std::map<std::string, std::string> query;
};
std::optional<Address> ParseAddress(std::string_view target);

/// The answer that refuses a request, or nothing: Host must name this machine, Origin be the
/// page's own, the site not another one, a body be JSON (of an upload: bytes), and for /api/... the
/// token be right. `hosts`: how often the header Host was there.
std::optional<Answer> Refuse(const Request& request, size_t hosts, std::string_view token);

/// Whether a request brings images or a recording, whose body is no JSON and may be long.
bool IsUpload(const Request& request);

/// 256 random bits in hexadecimal digits.
std::string MakeToken();

/// Headers of every answer.
std::map<std::string, std::string> SafetyHeaders();

}  // namespace plenocal::workbench
