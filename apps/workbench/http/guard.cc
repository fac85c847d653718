// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/http/guard.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"

namespace plenocal::workbench {
namespace {

constexpr size_t kLongestTarget = 4096;

int HexDigit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

// The part before `mark`, or all; both are taken from `rest`.
std::string_view Cut(std::string_view* rest, char mark) {
  const auto at = static_cast<size_t>(std::ranges::find(*rest, mark) - rest->begin());
  const std::string_view part = rest->substr(0, at);
  rest->remove_prefix(std::min(at + 1, rest->size()));
  return part;
}

std::optional<std::string> Decoded(std::string_view text) {
  std::string decoded;
  for (size_t i = 0; i < text.size(); ++i) {
    char c = text[i];
    if (c == '%') {
      if (i + 2 >= text.size()) return std::nullopt;
      const int high = HexDigit(text[i + 1]), low = HexDigit(text[i + 2]);
      if (high < 0 || low < 0) return std::nullopt;
      c = static_cast<char>(16 * high + low);
      i += 2;
    }
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) return std::nullopt;
    decoded += c;
  }
  return decoded;
}

bool IsSafePart(const std::string& part) {
  return part != "." && part != ".." && part.find_first_of("/\\") == std::string::npos;
}

// "127.0.0.1:8080" -> "127.0.0.1"; nothing unless a port of digits or none follows.
std::optional<std::string> HostName(std::string_view host) {
  // Of "[::1]:8080" the colon behind the bracket.
  std::string_view rest = host;
  if (host.starts_with('[')) Cut(&rest, ']');
  const bool has_port = std::ranges::find(rest, ':') != rest.end();
  Cut(&rest, ':');
  if (!has_port) return std::string(host);
  if (rest.empty() || rest.size() > 5 ||
      !std::ranges::all_of(rest, [](char c) { return c >= '0' && c <= '9'; })) {
    return std::nullopt;
  }
  return std::string(host.substr(0, host.size() - rest.size() - 1));
}

bool IsThisMachine(std::string_view host) {
  const std::optional<std::string> name = HostName(host);
  return name && (*name == "127.0.0.1" || *name == "localhost" || *name == "[::1]");
}

// In a time that does not depend on where they differ.
bool SameSecret(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned different = 0;
  for (size_t i = 0; i < a.size(); ++i) different |= static_cast<unsigned char>(a[i] ^ b[i]);
  return different == 0;
}

}  // namespace

std::string Request::Header(const std::string& name) const {
  const auto found = headers.find(name);
  return found == headers.end() ? std::string() : found->second;
}

std::string Request::Query(const std::string& name) const {
  const auto found = query.find(name);
  return found == query.end() ? std::string() : found->second;
}

Answer ErrorAnswer(int status, const std::string& what, const std::string& remedy) {
  const nlohmann::json json = {{"error", {{"what", Escaped(what)}, {"remedy", remedy}}}};
  return {.status = status, .body = json.dump()};
}

std::optional<Address> ParseAddress(std::string_view text) {
  if (text.size() > kLongestTarget || !text.starts_with('/')) return std::nullopt;
  Address target;
  std::string_view query = text;
  std::string_view path = Cut(&query, '?');
  path.remove_prefix(1);
  while (!path.empty()) {
    const std::optional<std::string> part = Decoded(Cut(&path, '/'));
    if (!part || !IsSafePart(*part)) return std::nullopt;
    target.path.push_back(*part);
  }
  while (!query.empty()) {
    std::string_view value = Cut(&query, '&');
    const auto name = Decoded(Cut(&value, '='));
    const auto decoded = Decoded(value);
    if (!name || !decoded) return std::nullopt;
    target.query[*name] = *decoded;
  }
  return target;
}

std::optional<Answer> Refuse(const Request& request, size_t hosts, std::string_view token) {
  const std::string host = request.Header("host");
  // A name that an attacker's DNS points here (rebinding) is still the attacker's name.
  if (hosts != 1 || !IsThisMachine(host)) {
    return ErrorAnswer(403, "this server answers for 127.0.0.1 and localhost alone");
  }
  const std::string origin = request.Header("origin");
  if (!origin.empty() && origin != "http://" + host) {
    return ErrorAnswer(403, "requests of other pages are refused");
  }
  const std::string site = request.Header("sec-fetch-site");
  if (!site.empty() && site != "same-origin" && site != "none") {
    return ErrorAnswer(403, "requests of other sites are refused");
  }
  if (request.path.empty() || request.path[0] != "api") return std::nullopt;
  const std::string authorization = request.Header("authorization");
  constexpr std::string_view kBearer = "Bearer ";
  if (!authorization.starts_with(kBearer) ||
      !SameSecret(std::string_view(authorization).substr(kBearer.size()), token)) {
    return ErrorAnswer(401,
                       "the token is missing or that of an earlier start",
                       "open the address that 'plenocal workbench' printed");
  }
  // Types that a form of another page cannot send.
  const char* const type = IsUpload(request) ? "application/octet-stream" : "application/json";
  if (!request.body.empty() && !request.Header("content-type").starts_with(type)) {
    return ErrorAnswer(415, fmt::format("a body is {} here", type));
  }
  return std::nullopt;
}

bool IsUpload(const Request& request) {
  using Path = std::vector<std::string>;
  return request.method == "POST" &&
         (request.path == Path{"api", "files"} || request.path == Path{"api", "look"});
}

std::string MakeToken() {
  std::array<std::uint8_t, 32> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    throw JobError("the system has no random numbers");
  }
  std::string token;
  for (const std::uint8_t byte : bytes) token += fmt::format("{:02x}", byte);
  return token;
}

std::map<std::string, std::string> SafetyHeaders() {
  return {{"Content-Security-Policy",
           "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
           "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'; "
           "require-trusted-types-for 'script'"},
          {"X-Content-Type-Options", "nosniff"},
          {"Referrer-Policy", "no-referrer"},
          {"Cross-Origin-Resource-Policy", "same-origin"},
          {"Cross-Origin-Opener-Policy", "same-origin"},
          {"Cache-Control", "no-store"}};
}

}  // namespace plenocal::workbench
