// SPDX-License-Identifier: Apache-2.0
#include "calib/io/yaml.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/depthguard.h>
#include <yaml-cpp/emitter.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <optional>
#include <sstream>
#include <unordered_map>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/io/input_file.h"

namespace plenocal {
namespace {

// Our own tree instead of YAML::Node: the parser's events tell the place of every key, show both of
// two equal keys and cannot be converted unsaid.
struct Tree {
  enum class Kind { kNull, kScalar, kSequence, kMap };
  Kind kind = Kind::kNull;
  int line = 1, column = 1;
  std::string scalar;
  bool quoted = false;         // a scalar that is text whatever it looks like
  bool flow = false;           // written in brackets
  std::vector<Tree> children;  // of a map key, value, key, value, ...
};

// A value from the file as part of a one-line message.
std::string Printable(std::string_view text) {
  constexpr size_t kLongest = 60;
  std::string printable(text.substr(0, kLongest));
  // Do not cut an UTF-8 character in two.
  if (text.size() > kLongest) {
    while (!printable.empty() && (printable.back() & 0x80) != 0) printable.pop_back();
    printable += "...";
  }
  return Escaped(printable);
}

std::string Describe(const Tree& tree) {
  switch (tree.kind) {
    case Tree::Kind::kNull:
      return "nothing";
    case Tree::Kind::kScalar:
      return fmt::format("'{}'", Printable(tree.scalar));
    case Tree::Kind::kSequence:
      return fmt::format("a list of {}", tree.children.size());
    case Tree::Kind::kMap:
      return "a map of keys and values";
  }
  return "";
}

struct Place {
  int line = 1, column = 1;

  Place() = default;
  Place(const Tree& tree) : line(tree.line), column(tree.column) {}
  Place(const YAML::Mark& mark) : line(mark.line + 1), column(mark.column + 1) {}
};

[[noreturn]] void FailAt(const std::string& file,
                         const Place& place,
                         const std::string& path,
                         const std::string& message) {
  const std::string key = path.empty() ? "" : path + ": ";
  throw InputError("{}:{}:{}: {}{}", file, place.line, place.column, key, message);
}

std::string Join(const std::string& path, std::string_view key) {
  return path.empty() ? Printable(key) : fmt::format("{}.{}", path, Printable(key));
}

// Refuses equal keys and keys that are no names, in all maps below `tree`.
void CheckMaps(const Tree& tree, const std::string& file, const std::string& path) {
  if (tree.kind == Tree::Kind::kSequence) {
    for (size_t i = 0; i < tree.children.size(); ++i) {
      if (tree.children[i].children.empty()) continue;
      CheckMaps(tree.children[i], file, fmt::format("{}[{}]", path, i));
    }
    return;
  }
  std::unordered_map<std::string_view, int> line_of_key;
  for (size_t i = 0; i < tree.children.size(); i += 2) {
    const Tree& key = tree.children[i];
    if (key.kind != Tree::Kind::kScalar) {
      FailAt(file,
             key,
             path,
             fmt::format("expected a name as key, got {}; write 'name: value'", Describe(key)));
    }
    const auto [first, is_new] = line_of_key.emplace(key.scalar, key.line);
    if (!is_new) {
      FailAt(
          file,
          key,
          Join(path, key.scalar),
          fmt::format("this key stands in line {} already; remove one of the two", first->second));
    }
    if (tree.children[i + 1].children.empty()) continue;
    CheckMaps(tree.children[i + 1], file, Join(path, key.scalar));
  }
}

class TreeBuilder : public YAML::EventHandler {
 public:
  explicit TreeBuilder(const std::string& file) : file_(file) {}

  void OnDocumentStart(const YAML::Mark& mark) override {
    if (root) Refuse(mark, "a second document starts here; keep one document in a file");
  }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    Open(mark, anchor, Tree::Kind::kNull);
    Close();
  }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t) override {
    Refuse(mark, "aliases ('*name') are not read; write the value itself");
  }
  void OnScalar(const YAML::Mark& mark,
                const std::string& tag,
                YAML::anchor_t anchor,
                const std::string& value) override {
    Tree& tree = Open(mark, anchor, Tree::Kind::kScalar);
    tree.scalar = value;
    tree.quoted = tag == "!";
    Close();
  }
  void OnSequenceStart(const YAML::Mark& mark,
                       const std::string&,
                       YAML::anchor_t anchor,
                       YAML::EmitterStyle::value style) override {
    Open(mark, anchor, Tree::Kind::kSequence).flow = style == YAML::EmitterStyle::Flow;
  }
  void OnSequenceEnd() override { Close(); }
  void OnMapStart(const YAML::Mark& mark,
                  const std::string&,
                  YAML::anchor_t anchor,
                  YAML::EmitterStyle::value style) override {
    Open(mark, anchor, Tree::Kind::kMap).flow = style == YAML::EmitterStyle::Flow;
  }
  void OnMapEnd() override { Close(); }

  std::optional<Tree> root;

 private:
  [[noreturn]] void Refuse(const YAML::Mark& mark, const std::string& message) const {
    FailAt(file_, mark, "", message);
  }

  Tree& Open(const YAML::Mark& mark, YAML::anchor_t anchor, Tree::Kind kind) {
    if (anchor != 0) Refuse(mark, "anchors ('&name') are not read; remove the anchor");
    Tree& tree = open_.emplace_back();
    tree.kind = kind;
    tree.line = mark.line + 1;
    tree.column = mark.column + 1;
    return tree;
  }

  void Close() {
    Tree tree = std::move(open_.back());
    open_.pop_back();
    if (open_.empty()) {
      root = std::move(tree);
      return;
    }
    std::vector<Tree>& siblings = open_.back().children;
    // The parser puts a missing value where the next token is, often some lines below its key.
    if (tree.kind == Tree::Kind::kNull && open_.back().kind == Tree::Kind::kMap &&
        siblings.size() % 2 == 1) {
      tree.line = siblings.back().line;
      tree.column = siblings.back().column;
    }
    siblings.push_back(std::move(tree));
  }

  const std::string& file_;
  std::vector<Tree> open_;
};

Tree ParseTree(const std::string& text, const std::string& file) {
  if (text.find('\0') != std::string::npos) {
    throw InputError("{}: expected YAML text (UTF-8), got binary data; is it the right file?",
                     file);
  }
  TreeBuilder builder(file);
  try {
    std::istringstream stream(text);
    YAML::Parser parser(stream);
    while (parser.HandleNextDocument(builder)) {
    }
  } catch (const YAML::DeepRecursion& error) {
    FailAt(file,
           error.mark,
           "",
           "brackets or lists are nested too deeply here; close those that are open");
  } catch (const YAML::Exception& error) {
    FailAt(
        file,
        error.mark.is_null() ? YAML::Mark() : error.mark,
        "",
        fmt::format("not valid YAML: {}; check indentation, brackets, quotes and the space after "
                    "each ':' around here",
                    Printable(error.msg)));
  }
  if (!builder.root || builder.root->kind == Tree::Kind::kNull) {
    throw InputError("{}: the file is empty; expected YAML that starts with 'plenocal: 1'", file);
  }
  CheckMaps(*builder.root, file, "");
  return std::move(*builder.root);
}

// The number that all of `text` is; from_chars, since it alone does not depend on the locale.
std::optional<double> ParseNumber(std::string_view text, std::string_view* rest = nullptr) {
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || !std::isfinite(value)) return std::nullopt;
  const std::string_view tail = text.substr(static_cast<size_t>(end - text.data()));
  if (rest != nullptr) {
    *rest = tail;
  } else if (!tail.empty()) {
    return std::nullopt;
  }
  return value;
}

// "; write 0.088" for a number with a unit, a decimal comma or the like.
std::string NumberHint(std::string_view text, std::string_view otherwise) {
  struct Unit {
    std::string_view name;
    double factor;
    std::string_view base;
  };
  constexpr double kDegree = std::numbers::pi / 180;
  static constexpr Unit kUnits[] = {{"deg", kDegree, "radians"},
                                    {"\u00b0", kDegree, "radians"},
                                    {"rad", 1, "radians"},
                                    {"s", 1, "seconds"},
                                    {"ms", 1e-3, "seconds"},
                                    {"px", 1, "pixels"},
                                    {"%", 1e-2, "a ratio"}};
  const std::optional<Length> length = ParseLength(text);
  if (length && length->has_unit) return fmt::format("; write {:.9g} (metres)", length->metres);
  std::string_view rest;
  if (const std::optional<double> number = ParseNumber(text, &rest)) {
    while (rest.starts_with(' ')) rest.remove_prefix(1);
    for (const Unit& unit : kUnits) {
      if (rest == unit.name) {
        return fmt::format("; write {:.9g} ({})", *number * unit.factor, unit.base);
      }
    }
    std::string with_point(text);
    std::replace(with_point.begin(), with_point.end(), ',', '.');
    if (rest.starts_with(',') && ParseNumber(with_point)) return "; write " + with_point;
  }
  return fmt::format("; write {}", otherwise);
}

void Emit(const Tree& tree, YAML::Emitter* out) {
  switch (tree.kind) {
    case Tree::Kind::kNull:
      *out << YAML::Null;
      break;
    case Tree::Kind::kScalar:
      if (tree.quoted) *out << YAML::DoubleQuoted;
      *out << tree.scalar;
      break;
    case Tree::Kind::kSequence:
    case Tree::Kind::kMap:
      const bool is_map = tree.kind == Tree::Kind::kMap;
      *out << (tree.flow ? YAML::Flow : YAML::Block) << (is_map ? YAML::BeginMap : YAML::BeginSeq);
      for (const Tree& child : tree.children) Emit(child, out);
      *out << (is_map ? YAML::EndMap : YAML::EndSeq);
  }
}

}  // namespace

// A place in the tree. Every node of a document keeps all of it alive.
struct YamlNode::Impl {
  struct Document {
    std::string file;
    Tree root;
  };
  std::shared_ptr<const Document> document;
  const Tree* tree;
  std::string path;  // "cameras.left.fixed[2]"

  [[noreturn]] void Expected(std::string_view what, const std::string& remedy) const {
    Fail(fmt::format("expected {}, got {}{}", what, Describe(*tree), remedy));
  }
  [[noreturn]] void Fail(const std::string& message) const {
    FailAt(document->file, *tree, path, message);
  }
  void Require(Tree::Kind kind, std::string_view what, const std::string& remedy) const {
    if (tree->kind != kind) Expected(what, remedy);
  }
  // The index of the key among the children of a map.
  [[nodiscard]] std::optional<size_t> Find(std::string_view key) const {
    for (size_t i = 0; i < tree->children.size(); i += 2) {
      if (tree->children[i].scalar == key) return i;
    }
    return std::nullopt;
  }
  [[nodiscard]] YamlNode Child(const Tree& child, std::string child_path) const {
    return YamlNode(std::make_shared<const Impl>(Impl{document, &child, std::move(child_path)}));
  }
  [[nodiscard]] double Number(std::string_view what, std::string_view example) const {
    const std::optional<double> value =
        tree->kind == Tree::Kind::kScalar ? ParseNumber(tree->scalar) : std::nullopt;
    if (!value) Expected(what, NumberHint(tree->scalar, example));
    return *value;
  }
  [[nodiscard]] double SignedLength(std::string_view what) const {
    const std::optional<Length> length =
        tree->kind == Tree::Kind::kScalar ? ParseLength(tree->scalar) : std::nullopt;
    if (!length) Expected(what, NumberHint(tree->scalar, "one such as 0.05 or 50 mm"));
    return length->metres;
  }
  // Squares of sizes and of standard errors must be numbers, too.
  void CheckSquare(double value, std::string_view what) const {
    if (!std::isnormal(value * value)) Expected(what, "; write one from 1e-150 to 1e150");
  }
  [[nodiscard]] double Positive(std::string_view what, std::string_view example) const {
    const double value = Number(what, example);
    if (value <= 0) Expected(what, fmt::format("; write a number above 0, such as {}", example));
    CheckSquare(value, what);
    return value;
  }
};

YamlNode YamlNode::ReadFile(const std::filesystem::path& path) {
  return Parse(ReadTextFile(path, InputLimit::kDocument), path.string());
}

YamlNode YamlNode::Parse(const std::string& text, const std::string& name) {
  const auto document =
      std::make_shared<const Impl::Document>(Impl::Document{name, ParseTree(text, name)});
  return YamlNode(std::make_shared<const Impl>(Impl{document, &document->root, ""}));
}

bool YamlNode::IsMap() const { return impl_->tree->kind == Tree::Kind::kMap; }
bool YamlNode::IsSequence() const { return impl_->tree->kind == Tree::Kind::kSequence; }
bool YamlNode::IsScalar() const { return impl_->tree->kind == Tree::Kind::kScalar; }

bool YamlNode::IsQuoted() const { return impl_->tree->quoted; }

bool YamlNode::Has(std::string_view key) const { return IsMap() && impl_->Find(key).has_value(); }

// " (is 'modle' meant for it?)" where a key of the map resembles the missing one.
static std::string SuggestPresent(const Tree& map, std::string_view missing) {
  std::vector<std::string_view> present;
  for (size_t i = 0; i < map.children.size(); i += 2) present.emplace_back(map.children[i].scalar);
  const std::string_view mistyped = NearestName(missing, present);
  return mistyped.empty() ? "" : fmt::format(" (is '{}' meant for it?)", mistyped);
}

YamlNode YamlNode::At(std::string_view key) const {
  impl_->Require(
      Tree::Kind::kMap, fmt::format("a map with the key '{}'", key), "; write 'key: value' lines");
  const std::string path = Join(impl_->path, key);
  const std::optional<size_t> found = impl_->Find(key);
  if (!found) {
    const Tree& tree = *impl_->tree;
    FailAt(impl_->document->file,
           tree,
           path,
           fmt::format("this key is missing; add '{}: ...'{}", key, SuggestPresent(tree, key)));
  }
  return impl_->Child(impl_->tree->children[*found + 1], path);
}

std::optional<YamlNode> YamlNode::Find(std::string_view key) const {
  return Has(key) ? std::optional(At(key)) : std::nullopt;
}

std::vector<YamlNode> YamlNode::Elements() const {
  impl_->Require(Tree::Kind::kSequence, "a list", "; write [a, b, ...]");
  std::vector<YamlNode> elements;
  elements.reserve(impl_->tree->children.size());
  for (const Tree& child : impl_->tree->children) {
    elements.push_back(impl_->Child(child, fmt::format("{}[{}]", impl_->path, elements.size())));
  }
  return elements;
}

std::vector<std::pair<std::string, YamlNode>> YamlNode::Entries() const {
  impl_->Require(Tree::Kind::kMap, "a map", "; write 'key: value' lines");
  std::vector<std::pair<std::string, YamlNode>> entries;
  const std::vector<Tree>& children = impl_->tree->children;
  entries.reserve(children.size() / 2);
  for (size_t i = 0; i < children.size(); i += 2) {
    const std::string& key = children[i].scalar;
    entries.emplace_back(key, impl_->Child(children[i + 1], Join(impl_->path, key)));
  }
  return entries;
}

std::string YamlNode::AsString() const {
  impl_->Require(Tree::Kind::kScalar, "a name or text", "; write one after the ':'");
  return impl_->tree->scalar;
}

double YamlNode::AsNumber() const { return impl_->Number("a finite number", "one such as 0.05"); }
double YamlNode::AsPositive() const { return impl_->Positive("a positive number", "0.05"); }

double YamlNode::AsLength() const {
  const char* what = "a length in metres or with its unit";
  const double value = impl_->SignedLength(what);
  if (value <= 0) impl_->Expected(what, "; write a number above 0, such as 0.05 or 50 mm");
  impl_->CheckSquare(value, what);
  return value;
}

double YamlNode::AsSignedLength() const {
  return impl_->SignedLength("a length in metres or with its unit");
}

std::vector<double> YamlNode::AsSignedLengths(std::size_t count) const {
  const std::vector<YamlNode> elements = IsSequence() ? Elements() : std::vector<YamlNode>();
  if (elements.size() != count) {
    impl_->Expected(fmt::format("{} lengths", count), "; write [number, number, ...]");
  }
  std::vector<double> lengths;
  for (const YamlNode& element : elements) lengths.push_back(element.AsSignedLength());
  return lengths;
}

int YamlNode::AsInteger() const {
  const char* what = "a whole number";
  const double value = impl_->Number(what, "one such as 6");
  std::string_view text = impl_->tree->scalar;
  if (text.starts_with('+')) text.remove_prefix(1);
  if (const std::optional<int> integer = ParseInt(text)) return *integer;
  constexpr double kLargest = 2147483647;
  if (std::abs(value) > kLargest) impl_->Expected(what, "; write one of at most 2147483647");
  impl_->Expected(what, fmt::format("; write {:.0f}", value));
}

bool YamlNode::AsBool() const {
  const std::string& text = impl_->tree->scalar;
  const auto is_one_of = [this, &text](std::initializer_list<std::string_view> words) {
    return IsScalar() && std::find(words.begin(), words.end(), text) != words.end();
  };
  if (is_one_of({"true", "True", "TRUE"})) return true;
  if (is_one_of({"false", "False", "FALSE"})) return false;
  const bool yes = is_one_of({"yes", "Yes", "YES", "on", "On", "ON", "1", "y", "Y"});
  const bool no = is_one_of({"no", "No", "NO", "off", "Off", "OFF", "0", "n", "N"});
  impl_->Expected("true or false", yes ? "; write true" : no ? "; write false" : "; write one");
}

std::vector<double> YamlNode::AsNumbers(std::size_t count) const {
  const std::string what = count == 0 ? "a list of numbers" : fmt::format("{} numbers", count);
  const char* remedy = "; write [number, number, ...]";
  impl_->Require(Tree::Kind::kSequence, what, remedy);
  const std::vector<Tree>& children = impl_->tree->children;
  if (count != 0 && children.size() != count) impl_->Expected(what, remedy);
  std::vector<double> numbers;
  numbers.reserve(children.size());
  for (const Tree& child : children) {
    const std::optional<double> value =
        child.kind == Tree::Kind::kScalar ? ParseNumber(child.scalar) : std::nullopt;
    // The path and the message only where they are needed: these lists are what is long in a file.
    numbers.push_back(
        value ? *value
              : impl_->Child(child, fmt::format("{}[{}]", impl_->path, numbers.size())).AsNumber());
  }
  return numbers;
}

void YamlNode::CheckKeys(std::initializer_list<std::string_view> known) const {
  CheckKeys(std::span<const std::string_view>(known.begin(), known.size()));
}

void YamlNode::CheckKeys(std::span<const std::string_view> known) const {
  impl_->Require(Tree::Kind::kMap, "a map", "; write 'key: value' lines");
  for (size_t i = 0; i < impl_->tree->children.size(); i += 2) {
    const Tree& key = impl_->tree->children[i];
    if (std::find(known.begin(), known.end(), key.scalar) != known.end()) continue;
    FailAt(impl_->document->file,
           key,
           Join(impl_->path, key.scalar),
           "unknown key" + SuggestName(key.scalar, known));
  }
}

void YamlNode::RequireKeys(std::span<const std::string_view> keys, std::string_view example) const {
  impl_->Require(Tree::Kind::kMap, "a map", "; write 'key: value' lines");
  std::vector<std::string> missing, lines;
  for (const std::string_view key : keys) {
    if (Has(key)) continue;
    missing.push_back(std::string(key) + SuggestPresent(*impl_->tree, key));
    std::string line = fmt::format("{}: ...", key);
    std::istringstream text{std::string(example)};
    for (std::string each; std::getline(text, each);) {
      if (each.starts_with(fmt::format("{}: ", key))) line = each;
    }
    lines.push_back(line);
  }
  if (missing.empty()) return;
  if (missing.size() == 1) {
    const std::string_view absent =
        *std::ranges::find_if(keys, [&](std::string_view key) { return !Has(key); });
    FailAt(impl_->document->file,
           *impl_->tree,
           Join(impl_->path, absent),
           fmt::format("this key is missing; add, for example, '{}'{}",
                       lines[0],
                       SuggestPresent(*impl_->tree, absent)));
  }
  Fail(fmt::format("these keys are missing: {}; add, for example, '{}'",
                   fmt::join(missing, ", "),
                   fmt::join(lines, "', '")));
}

void YamlNode::CheckVersion() const {
  if (!Has("plenocal")) impl_->Fail("expected a Plenocal file; start it with 'plenocal: 1'");
  const YamlNode version = At("plenocal");
  if (!version.IsScalar() || version.AsString() != "1") {
    version.impl_->Expected("format version 1", "; write 1, or use a newer Plenocal for the file");
  }
}

void YamlNode::Fail(const std::string& message) const { impl_->Fail(message); }

int YamlNode::Line() const { return impl_->tree->line; }

std::string YamlNode::Dump(std::initializer_list<std::string_view> without) const {
  Tree tree = *impl_->tree;
  if (IsMap()) {
    tree.flow = false;  // in lines, so that others can be added
    tree.children.clear();
    const std::vector<Tree>& children = impl_->tree->children;
    for (size_t i = 0; i < children.size(); i += 2) {
      if (std::find(without.begin(), without.end(), children[i].scalar) != without.end()) continue;
      tree.children.insert(tree.children.end(), {children[i], children[i + 1]});
    }
    if (tree.children.empty()) return "";
  }
  YAML::Emitter out;
  Emit(tree, &out);
  return std::string(out.c_str()) + "\n";
}

}  // namespace plenocal
