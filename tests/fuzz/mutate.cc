// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/mutate.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "calib/base/number_text.h"
#include "detectors/images/image.h"

namespace plenocal::fuzz {
namespace {

constexpr std::array<const char*, 16> kNumbers{"0",
                                               "-1",
                                               "1",
                                               "0.5",
                                               "1e-300",
                                               "1e300",
                                               "-1e300",
                                               "1e-12",
                                               "1e12",
                                               "1e-6",
                                               "1000000",
                                               "2147483647",
                                               "2147483648",
                                               "7",
                                               "nan",
                                               "inf"};
constexpr size_t kNames = 14;  // of the numbers, those that are no names for NaN and infinity

// Units (mm, degrees, radians), signs, and a little.
constexpr std::array kFactors{
    1000., 0.001, 57.29577951308232, 0.017453292519943295, -1., 2., 0.5, 1.01, 1e6, 1e-6};

std::string Changed(const std::string& number, size_t kind, Choices* choices) {
  const double value = ParseDouble(number).value_or(0);
  switch (kind) {
    case 0:
      return kNumbers[choices->Below(kNumbers.size())];
    case 1:
      return fmt::format("{}", value * kFactors[choices->Below(kFactors.size())]);
    default:
      return fmt::format("{}", std::round(value));
  }
}

// ---- tables: CSV, or words separated by blanks

class Table {
 public:
  explicit Table(const std::string& text) {
    separator_ = text.find(',') == std::string::npos ? ' ' : ',';
    std::vector<std::string> row(1);
    for (const char c : text) {
      if (c == separator_) {
        row.emplace_back();
      } else if (c == '\n') {
        rows_.push_back(std::exchange(row, std::vector<std::string>(1)));
      } else {
        row.back() += c;
      }
    }
    if (!rows_.empty() && !ParseDouble(rows_[0][0]) && separator_ == ',') {
      header_ = rows_[0];
      rows_.erase(rows_.begin());
    }
  }

  [[nodiscard]] std::string Text() const {
    std::string text;
    const std::string separator(1, separator_);
    if (!header_.empty()) text = fmt::format("{}\n", fmt::join(header_, separator));
    for (const auto& row : rows_) text += fmt::format("{}\n", fmt::join(row, separator));
    return text;
  }

  void Mutate(Choices* choices) {
    if (rows_.empty()) return;
    const size_t action = choices->Below(14), column = choices->Below(rows_[0].size());
    const size_t row = choices->Below(rows_.size()), other = choices->Below(rows_.size());
    switch (action) {
      case 0:
      case 1:
        Cell(row, column) = Other(Cell(row, column), column, action, choices);
        break;
      case 2:
        Cell(row, column) = Cell(other, column);
        break;
      case 3:
        std::swap(rows_[row], rows_[other]);
        break;
      case 4:
        rows_.insert(rows_.begin() + static_cast<long>(row), rows_[other]);
        break;
      case 5:
        rows_.erase(rows_.begin() + static_cast<long>(std::min(row, other)),
                    rows_.begin() + static_cast<long>(std::max(row, other)));
        break;
      case 6:
        RemoveAlike(column, Cell(row, column), choices->Below(2) == 0);
        break;
      case 7:
        SetColumn(column, Other(Cell(row, column), column, 0, choices));
        break;
      case 8:
        SetColumn(column, std::string(Cell(row, column)));
        break;
      case 9:
      case 10:
        MakeAffine(column, choices->Below(rows_[0].size()), choices);
        break;
      case 11:
        ChangeFrom(row, column, 1, choices);
        break;
      case 12:
        ChangeFrom(0, column, 1 + choices->Below(2), choices);
        break;
      default:
        SwapColumns(column, choices->Below(rows_[0].size()));
    }
  }

 private:
  std::string& Cell(size_t row, size_t column) {
    return rows_[row][std::min(column, rows_[row].size() - 1)];
  }

  // A name is no NaN: results may have it as it is.
  std::string Other(const std::string& cell, size_t column, size_t kind, Choices* choices) const {
    if (column == 0 || !ParseDouble(cell)) return kNumbers[choices->Below(kNames)];
    return Changed(cell, kind, choices);
  }

  void RemoveAlike(size_t column, const std::string& cell, bool others) {
    std::erase_if(rows_, [column, name = cell, others](const auto& row) {
      return (row[std::min(column, row.size() - 1)] == name) != others;
    });
  }

  void SetColumn(size_t column, const std::string& cell) {
    for (size_t row = 0; row < rows_.size(); ++row) Cell(row, column) = cell;
  }

  // Points on a line or a plane.
  void MakeAffine(size_t column, size_t of, Choices* choices) {
    const double factor = choices->Below(2) == 0 ? 1 : kFactors[choices->Below(kFactors.size())];
    const double more = static_cast<double>(choices->Below(3)) * 10;
    for (size_t row = 0; row < rows_.size(); ++row) {
      const auto value = ParseDouble(Cell(row, of));
      if (value && ParseDouble(Cell(row, column))) {
        Cell(row, column) = fmt::format("{}", factor * *value + more);
      }
    }
  }

  void ChangeFrom(size_t row, size_t column, size_t kind, Choices* choices) {
    const Choices same = *choices;
    for (; row < rows_.size(); ++row) {
      if (!ParseDouble(Cell(row, column))) continue;
      Choices again = same;
      Cell(row, column) = Changed(Cell(row, column), kind, &again);
    }
    if (kind < 2) static_cast<void>(choices->Below(2));
  }

  void SwapColumns(size_t column, size_t other) {
    for (size_t row = 0; row < rows_.size(); ++row) std::swap(Cell(row, column), Cell(row, other));
  }

  char separator_;
  std::vector<std::string> header_;
  std::vector<std::vector<std::string>> rows_;
};

// ---- documents: YAML

struct Span {
  size_t begin = 0, end = 0;
};

std::vector<Span> NumbersIn(const std::string& text) {
  std::vector<Span> numbers;
  const auto ends = [](char c) {
    return std::string_view(" \n,[]{}:").find(c) != std::string::npos;
  };
  for (size_t begin = 0; begin < text.size();) {
    size_t end = begin;
    while (end < text.size() && !ends(text[end])) ++end;
    if (end > begin && ParseDouble(text.substr(begin, end - begin)))
      numbers.push_back({begin, end});
    begin = end + 1;
  }
  return numbers;
}

void MutateLines(Choices* choices, std::string* text) {
  std::vector<Span> all;
  for (size_t begin = 0; begin < text->size();) {
    const size_t end = std::min(text->find('\n', begin), text->size() - 1) + 1;
    all.push_back({begin, end});
    begin = end;
  }
  if (all.empty()) return;
  const Span line = all[choices->Below(all.size())];
  const std::string copy = text->substr(line.begin, line.end - line.begin);
  if (choices->Below(2) == 0) {
    text->erase(line.begin, line.end - line.begin);
  } else {
    text->insert(all[choices->Below(all.size())].begin, copy);
  }
}

void MutateDocument(Choices* choices, std::string* text) {
  const std::vector<Span> numbers = NumbersIn(*text);
  const size_t action = choices->Below(10);
  if (numbers.empty() || action == 9) return MutateLines(choices, text);
  const Span number = numbers[choices->Below(numbers.size())];
  const std::string was = text->substr(number.begin, number.end - number.begin);
  std::string is;
  if (action == 8) {
    const Span other = numbers[choices->Below(numbers.size())];
    is = text->substr(other.begin, other.end - other.begin);
  } else {
    is = Changed(was, action % 3, choices);
    if (is == "nan" || is == "inf") is = "." + is;
  }
  text->replace(number.begin, number.end - number.begin, is);
}

// ---- images

std::string Pgm(const cv::Mat& image) {
  std::string content = fmt::format("P5\n{} {}\n255\n", image.cols, image.rows);
  for (int row = 0; row < image.rows; ++row) {
    content.append(image.ptr<char>(row), static_cast<size_t>(image.cols));
  }
  return content;
}

cv::Mat Noisy(const cv::Mat& image, double mean, double sigma, size_t seed) {
  cv::Mat noise(image.size(), CV_16S), sum;
  cv::RNG random(seed + 1);
  random.fill(noise, cv::RNG::NORMAL, mean, sigma);
  image.convertTo(sum, CV_16S);
  sum += noise;
  sum.convertTo(sum, CV_8U);
  return sum;
}

cv::Mat ChangedImage(const cv::Mat& image, Choices* choices) {
  const size_t action = choices->Below(12), level = choices->Below(256);
  const double gain = static_cast<double>(level) / 64;
  cv::Mat result;
  switch (action) {
    case 0:
      return {image.size(), CV_8U, cv::Scalar(static_cast<double>(level))};
    case 1:
      return Noisy(cv::Mat::zeros(image.size(), CV_8U), 128, 60, level);
    case 2:
      return Noisy(image, 0, static_cast<double>(level) / 8, level);
    case 3:
      image.convertTo(result, CV_8U, 8 * gain);  // saturated
      return result;
    case 4:
      image.convertTo(result, CV_8U, gain / 64, static_cast<double>(level));  // no contrast
      return result;
    case 5:
      return image(cv::Rect(0, 0, 1, 1)).clone();
    case 6:
      cv::rotate(image, result, static_cast<int>(level % 3));
      return result;
    case 7:
      cv::flip(image, result, static_cast<int>(level % 3) - 1);
      return result;
    case 8:
      cv::resize(image, result, {}, 0.1 + gain / 2, 0.1 + gain / 2);
      return result;
    case 9:
      return 255 - image;
    case 10:
      result = image.clone();
      result.rowRange(0, static_cast<int>(level) * image.rows / 256) = level % 2 * 255;
      return result;
    default:
      cv::GaussianBlur(image, result, {}, 0.3 + gain);
      return result;
  }
}

void MutateImage(Choices* choices, std::string* content) {
  const size_t action = choices->Below(10);
  if (action == 0) return content->resize(choices->Below(content->size()));
  try {
    const cv::Mat image =
        ToGray(DecodeRawGray(std::vector<std::uint8_t>(content->begin(), content->end()), "image"));
    if (image.depth() == CV_8U) *content = Pgm(ChangedImage(image, choices));
  } catch (const std::exception&) {
    return;  // an image that is truncated already
  }
}

bool EndsWithOneOf(const std::string& name, const std::vector<std::string>& endings) {
  return std::ranges::any_of(endings, [&](const auto& ending) { return name.ends_with(ending); });
}

}  // namespace

size_t Choices::Below(size_t count) {
  if (Empty() || count == 0) return 0;
  const size_t number =
      static_cast<unsigned char>(left_[0]) * 256U + static_cast<unsigned char>(left_[1]);
  left_.remove_prefix(2);
  return number % count;
}

void Mutate(const std::vector<std::string>& names, Choices* choices, Files* files) {
  constexpr int kMost = 8;
  for (int changes = 0; changes < kMost && !choices->Empty(); ++changes) {
    const std::string& name = names[choices->Below(names.size())];
    std::string* const content = &files->at(name);
    if (EndsWithOneOf(name, {".png", ".pgm"})) {
      MutateImage(choices, content);
    } else if (EndsWithOneOf(name, {".yaml"})) {
      MutateDocument(choices, content);
    } else {
      Table table(*content);
      table.Mutate(choices);
      *content = table.Text();
    }
  }
}

}  // namespace plenocal::fuzz
