// SPDX-License-Identifier: Apache-2.0
//
// Camera models from formulas.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "calib/camera/rays.h"
#include "models/check/model_properties.h"
#include "models/formula/grammar.h"
#include "models/formula/model.h"
#include "models/formula/tape.h"
#include "models/registry.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;

const CameraModel& ModelFrom(const std::string& name, const std::string& text) {
  return AddFormulaModel(name, YamlNode::Parse(text, name + ".model.yaml"), name + ".model.yaml");
}

// A header's formula: the header's name, and the text.
struct Written {
  const char* name;
  const char* text;
};
constexpr Written kFisheye{"kannala-brandt4",
                           "source: Kannala and Brandt, PAMI 2006\n"
                           "params: {k_1: {scale: 0.41}, k_2: {scale: 0.16}, k_3: {scale: 0.067},"
                           " k_4: {scale: 0.027}}\n"
                           "radius: theta*(1 + sum(i, 1, 4, k_i*theta^(2*i)))\n"
                           "example: [210, 212, 322, 243, -0.01, 0.003, -0.0002, 0.00001]\n"};
constexpr Written kRadial{"pinhole-radial3",
                          "source: Brown, Photogrammetric Engineering 1971\n"
                          "params: {A_0: {}, A_1: {}, A_2: {}}\n"
                          "radius: r*(1 + A_0*r^2 + A_1*r^4 + A_2*r^6)\n"
                          "example: [400, 405, 322, 243, -0.2, 0.06, -0.008]\n"};
constexpr Written kDoubleSphere{
    "double-sphere",
    "source: Usenko, Demmel and Cremers, 3DV 2018\n"
    "params: {xi: {bounds: [-1, 1], start: [0, -0.3, 0.5]}, alpha: {bounds: [0, 1], start: 0.5}}\n"
    "let:\n"
    "  r2: X^2 + Y^2\n"
    "  d_1: sqrt(r2 + Z^2)\n"
    "  z_1: xi*d_1 + Z\n"
    "  h: alpha*sqrt(r2 + z_1^2) + (1 - alpha)*z_1\n"
    "  w_1: if(alpha <= 0.5, alpha/(1 - alpha), (1 - alpha)/alpha)\n"
    "  w_2: (w_1 + xi)/sqrt(2*w_1*xi + xi^2 + 1)\n"
    "map: [X/h, Y/h]\n"
    "domain: [Z > -w_2*d_1, h > 0]\n"
    "example: [190, 191, 322, 243, -0.18, 0.59]\n"};
constexpr Written kRadtan8{
    "pinhole-radtan8",
    "source: OpenCV\n"
    "params: {k_1: {}, k_2: {}, p_1: {}, p_2: {}, k_3: {}, k_4: {}, k_5: {}, k_6: {}}\n"
    "let:\n"
    "  u: X/Z\n"
    "  v: Y/Z\n"
    "  q: u^2 + v^2\n"
    "  g: (1 + q*(k_1 + q*(k_2 + q*k_3)))/(1 + q*(k_4 + q*(k_5 + q*k_6)))\n"
    "map:\n"
    "  - u*g + 2*p_1*u*v + p_2*(q + 2*u^2)\n"
    "  - v*g + p_1*(q + 2*v^2) + 2*p_2*u*v\n"
    "example: [600, 605, 322, 243, 0.15, 0.06, 0.0008, -0.0005, -0.008, 0.33, 0.05, -0.004]\n"};
constexpr Written kDivision{"division",
                            "source: Fitzgibbon, CVPR 2001\n"
                            "params: {lambda: {}}\n"
                            "ray: [x, y, 1 + lambda*(x^2 + y^2)]\n"
                            "example: [250, 252, 322, 243, -0.22]\n"};

class FormulaOfHeader : public ::testing::TestWithParam<Written> {
 protected:
  [[nodiscard]] static const CameraModel& Formula() {
    return ModelFrom(fmt::format("formula-{}", GetParam().name), GetParam().text);
  }
  [[nodiscard]] static const CameraModel& Header() {
    return *FindModel(CameraModels(), GetParam().name);
  }
};

INSTANTIATE_TEST_SUITE_P(Headers,
                         FormulaOfHeader,
                         ::testing::Values(kFisheye, kRadial, kDoubleSphere, kRadtan8, kDivision),
                         [](const auto& test) {
                           std::string name(test.param.name);
                           std::erase(name, '-');
                           return name;
                         });

TEST_P(FormulaOfHeader, HasAllProperties) {
  for (const ModelProperty& property : ModelProperties()) {
    EXPECT_THAT(property.violations(Formula()), ::testing::IsEmpty()) << property.name;
  }
}

TEST_P(FormulaOfHeader, EqualsTheHeader) {
  const CameraModel &formula = Formula(), &header = Header();
  constexpr double kRounding = 1e-12;  // px
  const size_t count = header.params.size();
  ASSERT_EQ(formula.params.size(), count);
  const std::vector<double> params(header.example.begin(), header.example.end());
  std::vector<double> J_formula(2 * count), J_header(2 * count);
  for (int u = 0; u < header.example_size[0]; u += 13) {
    for (int v = 0; v < header.example_size[1]; v += 11) {
      const double pixel[kMaxObservationSize]{static_cast<double>(u), static_cast<double>(v)};
      const auto ray = header.Unproject(params.data(), nullptr, pixel);
      const auto again = formula.Unproject(params.data(), nullptr, pixel);
      ASSERT_TRUE(ray && again) << u << " " << v;
      EXPECT_LT((ray->direction - again->direction).norm(), 1e-12) << u << " " << v;
      const Eigen::Vector3d p = 2.5 * ray->direction;
      double one[2], other[2], J_one[6], J_other[6];
      ASSERT_TRUE(formula.ProjectWithJacobian(
          params.data(), nullptr, pixel, p, {one, J_formula.data(), J_one}));
      ASSERT_TRUE(header.ProjectWithJacobian(
          params.data(), nullptr, pixel, p, {other, J_header.data(), J_other}));
      for (int r = 0; r < 2; ++r) EXPECT_NEAR(one[r], other[r], kRounding);
      const auto norm = [](const double* J, size_t size) {
        return Eigen::Map<const Eigen::VectorXd>(J, static_cast<Eigen::Index>(size));
      };
      EXPECT_LE((norm(J_one, 6) - norm(J_other, 6)).norm(), 1e-9 * norm(J_other, 6).norm());
      EXPECT_LE((norm(J_formula.data(), 2 * count) - norm(J_header.data(), 2 * count)).norm(),
                1e-9 * norm(J_header.data(), 2 * count).norm());
    }
  }
}

TEST_P(FormulaOfHeader, GivesTheSameBytesWhereverABlockEnds) {
  const CameraModel& formula = Formula();
  const size_t count = formula.params.size(), points = 200;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::vector<double> p(3 * points);
  for (size_t i = 0; i < points; ++i) {
    p[3 * i] = normal(random);
    p[3 * i + 1] = normal(random);
    p[3 * i + 2] = 1 + normal(random);
  }
  const auto project = [&](size_t block) {
    std::vector<double> out(points * (2 + 2 * count + 6));
    double* const J_params = out.data() + 2 * points;
    double* const J_point = J_params + 2 * count * points;
    for (size_t i = 0; i < points; i += block) {
      ProjectPoints(formula,
                    formula.example.data(),
                    nullptr,
                    {std::min(block, points - i), p.data() + 3 * i},
                    {.predicted = out.data() + 2 * i,
                     .J_params = J_params + 2 * count * i,
                     .J_point = J_point + 6 * i});
    }
    return out;
  };
  const std::vector<double> all = project(points);
  for (const size_t block : {1, 2, 7, 63, 64, 65}) {
    const std::vector<double> parts = project(block);
    size_t different = 0;
    for (size_t i = 0; i < all.size(); ++i) {
      different += all[i] == parts[i] || (std::isnan(all[i]) && std::isnan(parts[i])) ? 0 : 1;
    }
    EXPECT_EQ(different, 0U) << block;
  }
}

std::string MessageOf(const std::string& text) {
  return testing::RefusalOf([&] { ModelFrom("wrong", text); });
}

struct Mistake {
  const char* name;
  std::string text;
  std::vector<std::string> parts;  // of the message
};

class WrongFormula : public ::testing::TestWithParam<Mistake> {};

std::string Repeated(const std::string& text, int times) {
  std::string all;
  for (int i = 0; i < times; ++i) all += text;
  return all;
}

INSTANTIATE_TEST_SUITE_P(
    All,
    WrongFormula,
    ::testing::Values(
        Mistake{"UnknownName",
                "params: {k_1: {}}\nradius: theta*(1 + k_2*theta^2)\n",
                {"wrong.model.yaml:2:", "radius", "column 12", "'k_2", "did you mean 'k_1'"}},
        Mistake{"UnknownFunction", "radius: sinn(theta)\n", {"'sinn'", "did you mean 'sin'"}},
        Mistake{"UseBeforeDefinition",
                "let: {a: b*2, b: X/Z}\nmap: [a, Y/Z]\n",
                {"wrong.model.yaml:1:", "let.a", "before its definition"}},
        Mistake{"WithoutEffect",
                "params: {k_1: {}, k_2: {}}\nradius: theta*(1 + k_1*theta^2)\n",
                {"radius", "'k_2' has no effect"}},
        Mistake{"EffectThatCancels",
                "params: {k_1: {}}\nradius: theta*(1 + k_1 - k_1)\n",
                {"'k_1' has no effect"}},
        Mistake{"SameEffect",
                "params: {a: {}, k_1: {}, b: {}}\nradius: theta*(1 + a*b*theta^2 + k_1*theta^4)\n"
                "example: [200, 200, 320, 240, 0.1, 0.01, 0.2]\n",
                {"changes of 'a', 'b' replace each other"}},
        Mistake{"EffectOfTheFocalLength",
                "params: {g: {start: 1}}\nradius: g*theta\nexample: [200, 200, 320, 240, 1]\n",
                {"changes of 'f_x', 'f_y', 'g' replace each other"}},
        Mistake{"DomainWithoutAxis",
                "map: [X/Z, Y/Z]\ndomain: [Z < 0]\n",
                {"domain", "axis at the example"}},
        Mistake{"EmptyDomain",
                "map: [X/Z, Y/Z]\ndomain: [Z > 0, 0*Z >= X^2 + Y^2]\n",
                {"domain is empty"}},
        Mistake{"NanOnTheAxis",
                "map: ['X*log(X^2 + Y^2)/Z', Y/Z]\n",
                {"'log(X^2 + Y^2)' is not finite on the optical axis"}},
        Mistake{"RootOnTheAxis",
                "let: {r2: X^2 + Y^2, a: sqrt(r2)}\nmap: [X/Z*(1 + a/Z), Y/Z]\n",
                {"'sqrt(r2)' has no derivative at X = Y = 0", "angle_over_radius", "sinc"}},
        Mistake{"RadiusThatShrinks", "radius: -theta\n", {"does not grow", "-1"}},
        Mistake{"RadiusNotZero", "radius: theta + 0.1\n", {"0.1 on the optical axis"}},
        Mistake{"ChangesAlongRay", "map: [X, Y]\n", {"changes along a ray"}},
        Mistake{"NoForm", "params: {k_1: {}}\n", {"map, radius and ray"}},
        Mistake{"TwoForms", "radius: theta\nmap: [X/Z, Y/Z]\n", {"map, radius and ray"}},
        Mistake{"TooManyMaps", "map: [X/Z, Y/Z, 1]\n", {"expected 2 formulas"}},
        Mistake{"Comma", "map: [min(X, Y), Y/Z]\n", {"quotes"}},
        Mistake{"NoNumber", "radius: 'theta*(1 + * 2)'\n", {"column 12", "expected a number"}},
        Mistake{"Unfinished", "radius: 'theta*'\n", {"column 7", "expected a number"}},
        Mistake{"NotClosed", "radius: 'theta*(1 + 2'\n", {"column 13", "expected ')'"}},
        Mistake{"Comparison", "radius: theta < 1\n", {"column 7", "comparison"}},
        Mistake{
            "UnmapOfRadius", "radius: theta\nunmap: [x, y, 1]\n", {"unmap", "belongs to 'map'"}},
        Mistake{"TakenName", "params: {theta: {}}\nradius: r*theta\n", {"has a meaning already"}},
        Mistake{"NoUnit",
                "params: {k_1: {unit: ''}}\nradius: theta*(1 + k_1*theta^2)\n",
                {"unit", "expected a unit; 1 if there is none"}},
        Mistake{"UnknownKey", "radius: theta\nparam: {}\n", {"param", "did you mean 'params'"}},
        Mistake{"Bounds",
                "params: {k_1: {bounds: [0, 1], start: 2}}\nradius: theta*k_1\n",
                {"start", "bounds"}},
        Mistake{"ExampleOutside",
                "params: {a: {bounds: [0, 1]}}\nradius: theta*a\nexample: [1, 1, 0, 0, 3]\n",
                {"a = 3"}},
        Mistake{"TooLong", "radius: theta" + Repeated("+theta-theta", 6000) + "\n", {"64 kB"}},
        Mistake{"TooManySums",
                "radius: \"sum(i, 1, 1000, sum(j, 1, 1000, theta))\"\n",
                {"longer than 20000 terms"}},
        Mistake{"TooManyNodes",
                "radius: \"theta*sum(i, 1, 1000, exp(i*theta) + cos(i + theta))\"\n",
                {"more than 4096 terms"}},
        Mistake{"TooDeep",
                "radius: " + Repeated("(", 200) + "theta" + Repeated(")", 200) + "\n",
                {"more than 100"}}),
    [](const auto& test) { return test.param.name; });

TEST_P(WrongFormula, IsRefusedWithPlaceAndRemedy) {
  const std::string message = MessageOf(GetParam().text);
  EXPECT_THAT(message, HasSubstr("wrong.model.yaml:"));
  for (const std::string& part : GetParam().parts) EXPECT_THAT(message, HasSubstr(part));
}

TEST(Formula, OfTheNameOfAnotherModelIsRefused) {
  const auto add = [](const std::string& name, const std::string& text, const std::string& file) {
    return testing::RefusalOf([&] { AddFormulaModel(name, YamlNode::Parse(text, file), file); });
  };
  EXPECT_THAT(add("eucm", "radius: theta", "a.yaml"), HasSubstr("name of a model"));
  EXPECT_THAT(add("Mine", "radius: theta", "a.yaml"), HasSubstr("a to z"));
  EXPECT_EQ(add("twice", "radius: theta", "a.yaml"), "no refusal");
  EXPECT_EQ(add("twice", "radius:  theta  # again", "b.yaml"), "no refusal");
  EXPECT_THAT(add("twice", "radius: 2*theta", "b.yaml"),
              AllOf(HasSubstr("a.yaml"), HasSubstr("b.yaml")));
}

TEST(Formula, HasTheFunctionsOfItsGrammar) {
  const auto value = [](const std::string& text) {
    formula::Graph graph;
    const int x = graph.Input(0);
    const std::vector<int> node{formula::Parse(text, {{"x", x}}, false, &graph)};
    const double at = 0.3;
    return formula::Tape(graph, node, 1).Evaluate(&at, nullptr, 1)[0][0];
  };
  EXPECT_DOUBLE_EQ(value("-x^2 + 2^-1"), 0.41);
  EXPECT_DOUBLE_EQ(value("2 - 1 - x/3/2"), 0.95);
  EXPECT_DOUBLE_EQ(value("sum(i, 1, 3, i*x^i)"), 0.3 + 2 * 0.09 + 3 * 0.027);
  EXPECT_DOUBLE_EQ(value("if(x >= 0.3, min(x, 1), max(x, 1))"), 0.3);
  EXPECT_DOUBLE_EQ(value("hypot(x, 0.4) + abs(-x) + x^2.5"), 0.5 + 0.3 + std::pow(0.3, 2.5));
  EXPECT_DOUBLE_EQ(value("sinc(x) + atan2(x, 2) + angle_over_radius(x^2, 1)"),
                   std::sin(0.3) / 0.3 + std::atan2(0.3, 2) + std::atan(0.3) / 0.3);
  EXPECT_DOUBLE_EQ(value("exp(x) + log(x) + sin(x) + cos(x) + tan(x) + asin(x) + acos(x)"),
                   std::exp(0.3) + std::log(0.3) + std::sin(0.3) + std::cos(0.3) + std::tan(0.3) +
                       std::asin(0.3) + std::acos(0.3));
  EXPECT_EQ(value("log(1 + 1e-17*x)"), 1e-17 * 0.3);
  EXPECT_EQ(value("log(1e-17*x + 1)"), value("log1p(1e-17*x)"));
  EXPECT_DOUBLE_EQ(value("atan(x) + sinh(x) + cosh(x) + tanh(x) + cos(pi)"),
                   std::atan(0.3) + std::sinh(0.3) + std::cosh(0.3) + std::tanh(0.3) - 1);
}

// A formula of every function has the derivatives of its differences.
TEST(Formula, HasExactDerivativesOfEveryFunction) {
  const CameraModel* const model = &ModelFrom(
      "all-functions",
      "params: {a: {start: 0.2}, b: {start: 0.1}, c: {start: 0.3}}\n"
      "let:\n"
      "  r2: (X^2 + Y^2)/(X^2 + Y^2 + Z^2)\n"
      "  t: angle_over_radius(X^2 + Y^2, Z)\n"
      "  q: t^2*(X^2 + Y^2)\n"
      "  f: exp(a*r2) + log(1 + b*r2) + sin(a*r2) + cos(b*r2) + tan(c*r2) + asin(a*r2) + acos(b*r2)\n"
      "  g: atan(a*r2) + sinh(b*r2) + cosh(c*r2) + tanh(a*r2) + abs(c - r2) + atan2(a + r2, 2)\n"
      "  h: sinc(c*r2) + min(a, r2) + max(r2, 3) + hypot(1, b) + (1 + r2)^a + sqrt(2 + c*r2)\n"
      "  i: if(r2 < 0.1, 1 + a*r2, 1 + b*r2)\n"
      "map: [X*t*(f + g + h)/10, Y*t*(f + g + h + i)/10]\n"
      "domain: [Z > 0, q < 2]\n");
  for (const ModelProperty& property : ModelProperties()) {
    if (property.name.find("Derivatives") == std::string_view::npos) continue;
    for (const std::string& violation : property.violations(*model)) {
      // At the edge of the image it may not be imaged.
      EXPECT_THAT(violation, ::testing::Not(HasSubstr("derivative of"))) << property.name;
    }
  }
}

// Random changes of formulas give a model or a message.
TEST(Formula, MutatedIsRefusedOrAModel) {
  constexpr const char* kPieces[]{"theta", "X",   "Z",  "k_1", "(",   ")",  "*",  "+",     "-",
                                  "/",     "^",   ",",  "0",   "1e9", "if", "<",  "sum(i", "sqrt(",
                                  "k_i",   "\n",  ": ", "[",   "]",   "r",  "x",  "sinc(", "'",
                                  "log(",  "let", "{",  "}",   "map", "pi", "17", "#",     "-1"};
  const char* const count = std::getenv("PLENOCAL_MUTATIONS");
  const int mutations = count == nullptr ? 100000 : std::atoi(count);
  std::mt19937 random(7);
  const auto below = [&](size_t n) { return static_cast<size_t>(random() % n); };
  int models = 0;
  for (int i = 0; i < mutations; ++i) {
    std::string text = std::array{kFisheye, kDoubleSphere, kRadtan8, kDivision}[below(4)].text;
    for (size_t change = below(4) + 1; change > 0; --change) {
      const size_t at = below(text.size());
      if (below(2) == 0) text.erase(at, 1 + below(4));
      if (below(3) != 0) text.insert(std::min(at, text.size()), kPieces[below(std::size(kPieces))]);
    }
    try {
      YamlNode node = YamlNode::Parse(text, "mutated");
      CheckFormula(node);
      ++models;
    } catch (const Error&) {
    }
  }
  EXPECT_GT(models, mutations / 100);
}

}  // namespace TEST_FILE
}  // namespace plenocal
