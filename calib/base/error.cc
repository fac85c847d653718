// SPDX-License-Identifier: Apache-2.0
#include "calib/base/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace plenocal {
namespace {

char Lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

size_t CommonPrefix(std::string_view a, std::string_view b) {
  size_t length = 0;
  while (length < std::min(a.size(), b.size()) && Lower(a[length]) == Lower(b[length])) ++length;
  return length;
}

// Damerau's edit distance (insert, delete, replace, swap of neighbours), blind to case.
size_t EditDistance(std::string_view a, std::string_view b) {
  std::vector<size_t> before_previous(b.size() + 1), previous(b.size() + 1), row(b.size() + 1);
  for (size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (size_t i = 1; i <= a.size(); ++i) {
    before_previous.swap(previous);
    previous.swap(row);
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      const bool equal = Lower(a[i - 1]) == Lower(b[j - 1]);
      row[j] = std::min({previous[j] + 1, row[j - 1] + 1, previous[j - 1] + (equal ? 0 : 1)});
      if (i > 1 && j > 1 && Lower(a[i - 1]) == Lower(b[j - 2]) &&
          Lower(a[i - 2]) == Lower(b[j - 1])) {
        row[j] = std::min(row[j], before_previous[j - 2] + 1);
      }
    }
  }
  return row[b.size()];
}

}  // namespace

std::string_view NearestName(std::string_view name, std::span<const std::string_view> known) {
  // Names are short; a longer one is no misspelling and would cost time for nothing.
  constexpr size_t kLongestName = 100;
  if (name.size() > kLongestName) return {};
  std::string_view nearest;
  // Among equally near names that which begins alike wins: people get beginnings right.
  std::pair<size_t, size_t> least;
  for (const std::string_view candidate : known) {
    const size_t distance = EditDistance(name, candidate);
    if (2 * distance > std::max(name.size(), candidate.size())) continue;
    const std::pair cost(distance, name.size() - CommonPrefix(name, candidate));
    if (nearest.empty() || cost < least) {
      nearest = candidate;
      least = cost;
    }
  }
  return nearest;
}

std::string SuggestName(std::string_view name, std::span<const std::string_view> known) {
  const std::string_view nearest = NearestName(name, known);
  if (!nearest.empty()) return fmt::format("; did you mean '{}'?", nearest);
  return known.empty() ? "" : fmt::format("; known: {}", fmt::join(known, ", "));
}

}  // namespace plenocal
