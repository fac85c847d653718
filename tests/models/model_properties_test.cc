// SPDX-License-Identifier: Apache-2.0
//
// Findings of `models check` on models with one mistake each.
#include "models/check/model_properties.h"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "models/registry.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const CameraModel& Right() { return *FindModel(CameraModels(), "pinhole-radtan4"); }

std::vector<std::string> Violations(const CameraModel& model, std::string_view name) {
  for (const ModelProperty& property : ModelProperties()) {
    if (property.name == name) return property.violations(model);
  }
  ADD_FAILURE() << name;
  return {};
}

bool Project(const double* params,
             const double* config,
             const double* values,
             const Eigen::Vector3d& p,
             double* predicted) {
  return Right().Project(params, config, values, p, predicted);
}

// Functions of wrong models: the right one's with a change.
template <auto change>
bool ProjectWith(const CameraModel& /*model*/,
                 const double* params,
                 const double* config,
                 const double* values,
                 const Eigen::Vector3d& p,
                 double /*h*/,
                 double* predicted) {
  return change(Project(params, config, values, p, predicted), p, predicted);
}
template <auto change>
bool JacobianWith(const CameraModel& model,
                  const double* params,
                  const double* config,
                  const double* values,
                  const Eigen::Vector3d& p,
                  double h,
                  const ProjectionOutput& out) {
  if (!Right().functions.project_with_jacobian(Right(), params, config, values, p, h, out)) {
    return false;
  }
  change(model, out);
  return true;
}
template <auto change>
std::optional<Ray> UnprojectWith(const CameraModel& /*model*/,
                                 const double* params,
                                 const double* config,
                                 const double* values) {
  std::optional<Ray> ray = Right().Unproject(params, config, values);
  if (ray) change(*ray);
  return ray;
}

template <typename Change>
CameraModel Wrong(const Change& change) {
  CameraModel wrong = Right();
  change(wrong);
  return wrong;
}

TEST(ModelProperties, OfARightModelHold) {
  size_t violated = 9;
  const std::string text = CheckModel(Right(), &violated);
  EXPECT_EQ(violated, 0) << text;
  for (const ModelProperty& property : ModelProperties()) {
    EXPECT_THAT(text, HasSubstr("holds      " + std::string(property.claim) + "\n"));
    EXPECT_THAT(property.violations(Right()), IsEmpty()) << property.name;
  }
}

TEST(ModelProperties, NameWhatIsNotDescribed) {
  const auto described = [](const auto& change) {
    return Violations(Wrong(change), "IsDescribed");
  };
  EXPECT_THAT(described([](CameraModel& m) { m.name = "Wide_lens"; }),
              ElementsAre(HasSubstr("name 'Wide_lens': only a to z")));
  EXPECT_THAT(described([](CameraModel& m) { m.name = ""; }), ElementsAre(HasSubstr("name ''")));
  EXPECT_THAT(described([](CameraModel& m) { m.name = "a-z09+x"; }), IsEmpty());
  EXPECT_THAT(described([](CameraModel& m) { m.source = ""; }), ElementsAre("no source"));
  EXPECT_THAT(described([](CameraModel& m) { m.params = m.params.first(7); }),
              ElementsAre(HasSubstr("another number of parameters")));
  EXPECT_THAT(described([](CameraModel& m) { m.params = {}, m.example = {}; }),
              ElementsAre("no parameters"));
  EXPECT_THAT(described([](CameraModel& m) { m.measured = {}; }),
              ElementsAre("nothing is measured"));
  EXPECT_THAT(described([](CameraModel& m) {
                m.example_size = {640, 0};
              }),
              ElementsAre("the example has no image"));
  EXPECT_THAT(described([](CameraModel& m) {
                m.example_size = {0, 480};
              }),
              ElementsAre("the example has no image"));
  static constexpr std::array<std::string_view, 2> kCamera{"x", "camera"};
  EXPECT_THAT(described([](CameraModel& m) { m.measured = kCamera; }),
              ElementsAre("coordinate camera is a column already"));
  static constexpr std::array<std::string_view, 1> kX{"x"};
  EXPECT_THAT(described([](CameraModel& m) { m.context = kX; }),
              ElementsAre("coordinate x is a column already"));
  static constexpr std::array<std::string_view, 6> kSix{"a", "b", "c", "d", "e", ""};
  EXPECT_THAT(described([](CameraModel& m) { m.context = kSix; }),
              ElementsAre("an observation holds more than 7 numbers", "a coordinate has no name"));
}

TEST(ModelProperties, NameParametersThatAreNotDescribed) {
  const auto described = [](const auto& change) {
    std::vector<Param> params(Right().params.begin(), Right().params.end());
    change(params);
    return Violations(Wrong([&](CameraModel& m) { m.params = params; }), "IsDescribed");
  };
  EXPECT_THAT(described([](auto& params) { params[1].name = ""; }),
              ElementsAre("parameter 1 has no name"));
  EXPECT_THAT(described([](auto& params) { params[1].unit = ""; }), ElementsAre("f_y has no unit"));
  EXPECT_THAT(described([](auto& params) { params[1].name = "f_x"; }),
              ElementsAre("f_x stands twice"));
  EXPECT_THAT(described([](auto& params) { params[1].scale = -1; }),
              ElementsAre("f_y has a negative scale"));
  const double f_y = Right().example[1];
  EXPECT_THAT(described([&](auto& params) { params[1].upper = f_y; }),
              ElementsAre(HasSubstr("the example's f_y = ")));
  EXPECT_THAT(described([&](auto& params) { params[1].lower = f_y; }),
              ElementsAre(HasSubstr("is not within its limits")));
}

TEST(ModelProperties, NamePixelsThatAreNotFoundAgain) {
  const auto found = [](const auto& change) {
    return Violations(Wrong(change), "FindsPixelsAgain");
  };
  EXPECT_THAT(found([](CameraModel& m) {
                m.functions.unproject = UnprojectWith<[](Ray& ray) { ray.direction *= 1 + 1e-9; }>;
              }),
              Contains(HasSubstr("has length 1.000000001")));
  EXPECT_THAT(found([](CameraModel& m) {
                m.functions.unproject = UnprojectWith<[](Ray& ray) {
                  ray.direction.x() += 1e-9;
                  ray.direction.normalize();
                }>;
              }),
              Contains(AllOf(HasSubstr("100 m along its ray: x off by "))));
  EXPECT_THAT(found([](CameraModel& m) {
                m.functions.unproject = [](const auto&, auto, auto, auto) {
                  return std::optional<Ray>();
                };
              }),
              Contains(HasSubstr("pixel (0, 0) has no ray")));
  EXPECT_THAT(found([](CameraModel& m) {
                m.functions.project = ProjectWith<[](bool seen, const Eigen::Vector3d& p, double*) {
                  return seen && p.norm() < 50;
                }>;
              }),
              Contains(HasSubstr("the point 100 m along the ray of pixel (0, 0) is not imaged")));
}

TEST(ModelProperties, NameDirectionsThatAreNotFoundAgain) {
  EXPECT_THAT(Violations(Wrong([](CameraModel& m) {
                           m.functions.unproject = UnprojectWith<[](Ray& ray) {
                             ray.direction.y() += 1e-9;
                             ray.direction.normalize();
                           }>;
                         }),
                         "FindsDirectionsAgain"),
              Contains(HasSubstr("comes back wrong by 1e-09")));
  EXPECT_THAT(
      Violations(Wrong([](CameraModel& m) {
                   m.functions.project =
                       ProjectWith<[](bool, const Eigen::Vector3d&, double*) { return false; }>;
                 }),
                 "FindsDirectionsAgain"),
      ElementsAre("nothing is imaged around the optical axis"));
}

TEST(ModelProperties, NameAFold) {
  // What lies behind is imaged as its mirror image.
  EXPECT_THAT(Violations(Wrong([](CameraModel& m) {
                           m.functions.project = [](const CameraModel&,
                                                    const double* params,
                                                    const double* config,
                                                    const double* values,
                                                    const Eigen::Vector3d& p,
                                                    double,
                                                    double* predicted) {
                             return Project(params,
                                            config,
                                            values,
                                            p.z() < -0.5 * p.norm() ? Eigen::Vector3d(-p) : p,
                                            predicted);
                           };
                         }),
                         "HasOneDomain"),
              Contains(HasSubstr("beyond the edge of the domain")));
  // A hole within.
  EXPECT_THAT(Violations(Wrong([](CameraModel& m) {
                           m.functions.project =
                               ProjectWith<[](bool seen, const Eigen::Vector3d& p, double*) {
                                 const double tan = p.head<2>().norm() / p.z();
                                 return seen && !(0.1015 < tan && tan < 0.1075);
                               }>;
                         }),
                         "HasOneDomain"),
              Contains(HasSubstr("inside the domain's edge")));
  EXPECT_THAT(Violations(Wrong([](CameraModel& m) {
                           m.functions.project =
                               ProjectWith<[](bool seen, const Eigen::Vector3d& p, double* u) {
                                 u[0] = u[1] = p.isZero() ? 0 : u[0];
                                 return seen || p.isZero();
                               }>;
                         }),
                         "HasOneDomain"),
              Contains("the camera frame's origin is imaged"));
}

TEST(ModelProperties, NameNumbersThatAreNotFinite) {
  const auto nan = [](const auto& change) { return Violations(Wrong(change), "GivesNoNan"); };
  EXPECT_THAT(nan([](CameraModel& m) {
                m.functions.project =
                    ProjectWith<[](bool seen, const Eigen::Vector3d& p, double* u) {
                      if (seen && 1e100 < p.z()) u[1] = std::numeric_limits<double>::infinity();
                      return seen;
                    }>;
              }),
              Contains(HasSubstr("is not finite")));
  EXPECT_THAT(nan([](CameraModel& m) {
                m.functions.project =
                    ProjectWith<[](bool seen, const Eigen::Vector3d& p, double* u) {
                      if (!p.allFinite()) u[0] = u[1] = 0;
                      return seen || !p.allFinite();
                    }>;
              }),
              ElementsAre(HasSubstr("point (nan, 0, 1) is imaged"),
                          HasSubstr("point (0, 0, nan) is imaged")));
  EXPECT_THAT(nan([](CameraModel& m) {
                m.functions.unproject = UnprojectWith<[](Ray& ray) {
                  ray.origin.x() = std::numeric_limits<double>::quiet_NaN();
                }>;
              }),
              Contains(HasSubstr("the ray of pixel")));
  EXPECT_THAT(nan([](CameraModel& m) {
                m.functions.project_with_jacobian =
                    JacobianWith<[](const CameraModel&, const ProjectionOutput& out) {
                      out.predicted[0] = std::numeric_limits<double>::quiet_NaN();
                    }>;
              }),
              Contains(HasSubstr("with derivatives, the image of")));
}

TEST(ModelProperties, NameWrongDerivatives) {
  const CameraModel by_param = Wrong([](CameraModel& m) {
    m.functions.project_with_jacobian =
        JacobianWith<[](const CameraModel&, const ProjectionOutput& out) {
          if (out.J_params != nullptr)
            out.J_params[4] *= 1 + 1e-4;  // of x by the first coefficient
        }>;
  });
  EXPECT_THAT(Violations(by_param, "HasDerivativesOverTheImage"),
              Contains(HasSubstr("derivative of x by ")));
  const CameraModel by_point = Wrong([](CameraModel& m) {
    m.functions.project_with_jacobian =
        JacobianWith<[](const CameraModel&, const ProjectionOutput& out) {
          out.J_point[5] *= 1 + 1e-4;  // of y by z
        }>;
  });
  for (const char* name : {"HasDerivativesOverTheImage", "HasDerivativesAtTheEdge"}) {
    EXPECT_THAT(Violations(by_point, name), Contains(HasSubstr("derivative of y by z at ")))
        << name;
  }
  const CameraModel on_axis = Wrong([](CameraModel& m) {
    m.functions.project_with_jacobian =
        JacobianWith<[](const CameraModel&, const ProjectionOutput& out) {
          out.J_point[0] += 1;  // of x by x
        }>;
  });
  EXPECT_THAT(Violations(on_axis, "HasDerivativesOnTheAxis"),
              Contains(HasSubstr("derivative of x by x at (0, 0, 100)")));
  const CameraModel another_image = Wrong([](CameraModel& m) {
    m.functions.project_with_jacobian =
        JacobianWith<[](const CameraModel&, const ProjectionOutput& out) {
          out.predicted[1] += 1e-9;
        }>;
  });
  EXPECT_THAT(Violations(another_image, "HasDerivativesOverTheImage"),
              Contains(HasSubstr("depends on the scalar type")));
  const CameraModel without_params = Wrong([](CameraModel& m) {
    m.functions.project_with_jacobian =
        JacobianWith<[](const CameraModel&, const ProjectionOutput& out) {
          if (out.J_params == nullptr) out.J_point[1] += 1e-3;
        }>;
  });
  EXPECT_THAT(Violations(without_params, "HasDerivativesOverTheImage"),
              Contains(HasSubstr("depend on whether those by parameters are needed")));
}

TEST(ModelProperties, NameRaysThatDoNotMeet) {
  const CameraModel wrong = Wrong([](CameraModel& m) {
    m.functions.unproject = UnprojectWith<[](Ray& ray) { ray.origin.z() = 1e-3; }>;
  });
  EXPECT_THAT(Violations(wrong, "IsCentral"), Contains(HasSubstr("starts at (0, 0, 0.001)")));
  const CameraModel changes = Wrong([](CameraModel& m) {
    m.functions.project_with_jacobian =
        JacobianWith<[](const CameraModel&, const ProjectionOutput& out) {
          out.J_point[2] += 1e-3;
        }>;
  });
  EXPECT_THAT(Violations(changes, "IsCentral"),
              Contains(HasSubstr("x changes along the ray of pixel")));
}

TEST(ModelProperties, NameWhatIsOtherwiseInABlock) {
  const CameraModel wrong = Wrong([](CameraModel& m) {
    m.functions.project_block = [](const CameraModel&,
                                   const double*,
                                   const double*,
                                   const PointBlock& in,
                                   const ProjectionOutput& out) {
      for (size_t i = 0; i < 2 * in.count; ++i) out.predicted[i] = 0;
    };
  });
  EXPECT_THAT(Violations(wrong, "AgreesInBlocks"), Contains(HasSubstr("in a block gives 0 for ")));
}

TEST(ModelProperties, AreListedWithThreeExamplesEach) {
  size_t violated = 0;
  const std::string text = CheckModel(Wrong([](CameraModel& m) {
                                        m.functions.unproject =
                                            UnprojectWith<[](Ray& ray) { ray.direction *= 1.001; }>;
                                      }),
                                      &violated);
  EXPECT_EQ(violated, 2) << text;  // directions are not found again, either
  EXPECT_THAT(text,
              HasSubstr("VIOLATED   the whole example image is seen, and points on a pixel's ray "
                        "are imaged in that pixel\n             direction of pixel (0, 0) has "));
  EXPECT_THAT(text, HasSubstr("             and 438 more\n"));  // of 21 x 21
  EXPECT_EQ(text.find("not asked"), std::string::npos);
  const CameraModel& plenoptic = *FindModel(CameraModels(), "focused-plenoptic");
  EXPECT_THAT(CheckModel(plenoptic, &violated), HasSubstr("not asked  "));
  EXPECT_EQ(violated, 0);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
