// SPDX-License-Identifier: Apache-2.0
//
// Every reader reads its files in the corpus, which bench/fuzz started from and to which each input
// that broke a reader was added, and damaged copies of them. Every command runs on sessions
// that are changed by its files in the corpus and by random inputs: 8, or PLENOCAL_FUZZ_RUNS, of
// the seeds from PLENOCAL_FUZZ_SEED on.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iterator>
#include <random>

#include "tests/fuzz/readers.h"

namespace plenocal::fuzz {
namespace {

namespace fs = std::filesystem;

// For one input, s; sanitizers take several times as long.
constexpr double kLongest = PLENOCAL_SLOWDOWN * 10, kLongestCommand = PLENOCAL_SLOWDOWN * 20;
constexpr long kMostMemory = 1L << 20;  // kB

std::vector<std::string> InputsOf(const Reader& reader) {
  std::vector<fs::path> paths;
  const fs::path folder = fs::path(PLENOCAL_CORPUS) / reader.name;
  if (fs::exists(folder)) {
    for (const auto& entry : fs::directory_iterator(folder)) paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<std::string> inputs;
  if (reader.is_command) inputs.emplace_back();  // changes nothing
  for (const fs::path& path : paths) {
    std::ifstream file(path, std::ios::binary);
    inputs.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return inputs;
}

// Damages inputs as libFuzzer does, the same way in every run.
class Damage {
 public:
  explicit Damage(const std::vector<std::string>& inputs) : inputs_(inputs) {}

  std::string Next() {
    std::string input = inputs_[Below(inputs_.size())];
    for (size_t steps = 1 + Below(4); steps > 0; --steps) Step(&input);
    return input;
  }

 private:
  size_t Below(size_t count) { return count == 0 ? 0 : random_() % count; }

  void Step(std::string* input) {
    static constexpr std::string_view kWords[] = {
        "nan", "inf",  "-1",  "0", "1e308", "-1e-320", "2147483648", "18446744073709551615",
        "1e9", "\"",   "'",   "[", "]",     "{",       "}",          ":",
        ",",   "\n",   "-",   "#", "%",     "*",       "&",          "<",
        ">",   "\xff", "\x7f"};
    const std::string_view word = kWords[Below(std::size(kWords))];
    const size_t at = Below(input->size() + 1), size = Below(input->size() - at + 1);
    switch (Below(6)) {
      case 0:
        if (at < input->size()) (*input)[at] = static_cast<char>(random_());
        break;
      case 1:
        input->erase(at, size);
        break;
      case 2:
        input->insert(at, input->substr(at, size));
        break;
      case 3:
        input->insert(at, word);
        break;
      case 4:
        input->replace(at, size, inputs_[Below(inputs_.size())], 0, Below(1000));
        break;
      default:
        ReplaceNumber(at, word, input);
    }
  }

  // The first number after `at`.
  static void ReplaceNumber(size_t at, std::string_view word, std::string* input) {
    constexpr const char* kDigits = "0123456789.+-e";
    const size_t begin = input->find_first_of("0123456789", at);
    if (begin == std::string::npos) return;
    const size_t end = std::min(input->find_first_not_of(kDigits, begin), input->size());
    input->replace(begin, end - begin, word);
  }

  const std::vector<std::string>& inputs_;
  std::mt19937 random_;  // the same numbers in every run
};

// As `xxd -r -p` makes a file of it.
std::string Hexadecimal(const std::string& input) {
  std::string text;
  for (const char byte : input) text += fmt::format("{:02x}", static_cast<unsigned char>(byte));
  return text;
}

// Of all threads, s.
double ProcessorTime() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

class EveryReader : public ::testing::TestWithParam<std::string> {
 protected:
  // True when the input is accepted.
  bool Read(const std::string& input) {
    const std::string shown = reader_.is_command ? Hexadecimal(input) : input;
    const double start = ProcessorTime();
    bool accepted = false;
    EXPECT_NO_THROW(accepted = fuzz::Read(reader_, input)) << "input: " << shown;
    EXPECT_LT(ProcessorTime() - start, reader_.is_command ? kLongestCommand : kLongest)
        << "input: " << shown;
    return accepted;
  }

  void TearDown() override {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    EXPECT_LT(usage.ru_maxrss, kMostMemory);
  }

  const Reader& reader_ = FindReader(GetParam());
  const std::vector<std::string> inputs_ = InputsOf(reader_);
};

TEST_P(EveryReader, ReadsOrRefusesItsCorpus) {
  size_t accepted = 0;
  for (const std::string& input : inputs_) accepted += Read(input) ? 1 : 0;
  EXPECT_GT(accepted, 0U) << "no file of the corpus is a good one";
}

TEST_P(EveryReader, ReadsOrRefusesDamagedFiles) {
  constexpr int kInputs = 1000;
  Damage damage(inputs_);
  for (int i = 0; i < kInputs && !HasFailure(); ++i) Read(damage.Next());
}

class EveryCommand : public EveryReader {};

TEST_P(EveryCommand, RunsOrRefusesItsCorpus) {
  size_t done = 0;
  for (const std::string& input : inputs_) done += Read(input) ? 1 : 0;
  EXPECT_GT(done, 0U) << "the command is refused without a change";
}

unsigned NumberOf(const char* variable, unsigned otherwise) {
  const char* const text = std::getenv(variable);
  return text == nullptr ? otherwise : static_cast<unsigned>(std::stoul(text));
}

TEST_P(EveryCommand, RunsOrRefusesChangedSessions) {
  constexpr unsigned kFewest = 8, kMore = 48;  // bytes of an input
  const unsigned first = NumberOf("PLENOCAL_FUZZ_SEED", 1);
  const unsigned runs = NumberOf("PLENOCAL_FUZZ_RUNS", 8);
  for (unsigned seed = first; seed < first + runs; ++seed) {
    std::mt19937 random(seed);
    std::string input(kFewest + random() % kMore, ' ');
    std::ranges::generate(input, [&random] { return static_cast<char>(random()); });
    Read(input);
  }
}

std::vector<std::string> Names(bool commands) {
  std::vector<std::string> names;
  for (const Reader& reader : Readers()) {
    if (reader.is_command == commands) names.push_back(reader.name);
  }
  return names;
}

std::string TestName(const ::testing::TestParamInfo<std::string>& param) {
  std::string name = param.param;
  std::ranges::replace(name, '-', '_');
  return name;
}

INSTANTIATE_TEST_SUITE_P(Fuzz, EveryReader, ::testing::ValuesIn(Names(false)), TestName);
INSTANTIATE_TEST_SUITE_P(Fuzz, EveryCommand, ::testing::ValuesIn(Names(true)), TestName);

}  // namespace
}  // namespace plenocal::fuzz
