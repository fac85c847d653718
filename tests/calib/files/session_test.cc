// SPDX-License-Identifier: Apache-2.0
//
// session.yaml as data.
#include "calib/files/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

enum { kFx, kFy, kCx, kCy, kK1 };

class SessionText : public testing::InTemporaryFolder {
 protected:
  /// A session of these cameras, with other lines before them.
  [[nodiscard]] Session Parse(const std::string& cameras,
                              const std::string& lines = "target: target.yaml\n") const {
    return ParseSession(
        "plenocal: 1\n" + lines + "cameras:\n" + cameras, Path("session.yaml"), CameraModels());
  }
  template <typename... Arguments>
  [[nodiscard]] std::string Refused(const Arguments&... arguments) const {
    return testing::RefusalOf([&] { (void)Parse(arguments...); });
  }
};

TEST_F(SessionText, HasCamerasWithTheirImages) {
  const Session session = Parse(
      "  left:\n"
      "    model: pinhole-radtan\n"
      "    images: [left/*.png, more]\n"
      "    white_images: white\n"
      "    bayer: RGGB\n"
      "    times: times.csv\n"
      "    image_circle: [320, 240, 300, 200]\n"
      "    initial: {f_x: 800, k_1: -0.1}\n"
      "    fixed: [k_1, p_1]\n"
      "  light: {model: focused-plenoptic, detections: light.csv, image_size: [2048, 2000], "
      "pixel_size: 5.5 um}\n"
      "  any: {model: auto, images: any.bag}\n");
  ASSERT_EQ(session.cameras.size(), 3U);
  const SessionCamera &left = session.cameras[0], &light = session.cameras[1],
                      &any = session.cameras[2];
  EXPECT_EQ(left.name, "left");
  EXPECT_EQ(left.model->name, "pinhole-radtan");
  EXPECT_THAT(left.images, ElementsAre(Path("left/*.png"), Path("more")));
  EXPECT_THAT(left.white_images, ElementsAre(Path("white")));
  EXPECT_EQ(left.bayer, BayerOrder::kRggb);
  EXPECT_EQ(left.times, Path("times.csv"));
  EXPECT_EQ(left.image_size, (ImageSize{0, 0}));
  EXPECT_EQ(left.image_circle->radii, Eigen::Vector2d(300, 200));
  EXPECT_EQ(left.initial[kFx], 800);
  EXPECT_EQ(left.initial[kFy], std::nullopt);
  EXPECT_EQ(left.initial[kK1], -0.1);
  const auto p_1 = static_cast<size_t>(std::ranges::find(left.model->params, "p_1", &Param::name) -
                                       left.model->params.begin());
  EXPECT_EQ(left.initial[p_1], 0) << "where it has no effect";
  for (size_t k = 0; k < left.fixed.size(); ++k) EXPECT_EQ(left.fixed[k], k == kK1 || k == p_1);
  EXPECT_THAT(left.rules, IsEmpty());
  EXPECT_TRUE(HasImages(left));
  EXPECT_EQ(light.detections, Path("light.csv"));
  EXPECT_EQ(light.image_size, (ImageSize{2048, 2000}));
  EXPECT_THAT(light.config, ElementsAre(5.5e-6));
  EXPECT_FALSE(HasImages(light));
  EXPECT_FALSE(light.auto_model);
  EXPECT_TRUE(any.auto_model);
  EXPECT_EQ(any.model->name, kUsualModel);
  EXPECT_THAT(Refused("  a: {model: pinhole, images: a, fixed: [f_x]}\n"),
              HasSubstr("'f_x' is to be fixed, but 'initial' gives no value for it"));
  EXPECT_THAT(Refused("  a: {model: pinhole, images: a, detections: b}\n"),
              HasSubstr("give either"));
  EXPECT_THAT(Refused("  a: {model: pinhole, detections: b}\n"), HasSubstr("needs 'image_size"));
  EXPECT_THAT(Refused("  a: {model: auto, images: a, fixed: [f_x]}\n"),
              HasSubstr("is about one camera model"));
}

TEST_F(SessionText, HasPriorsAndBounds) {
  const Session session = Parse(
      "  a:\n"
      "    model: pinhole-radtan\n"
      "    images: a\n"
      "    initial: {f_y: 790}\n"
      "    prior: {f_x: {value: 805, sigma: 2}, f_y: {value: 795, sigma: 1}}\n"
      "    bounds: {f_y: [780, 800], c_x: [300, 340]}\n"
      "  b: {model: pinhole, images: b}\n");
  const std::vector<ParamRule>& rules = session.cameras[0].rules;
  ASSERT_TRUE(rules[kFx].prior && rules[kFy].prior);
  EXPECT_EQ(rules[kFx].prior->value, 805);
  EXPECT_EQ(rules[kFx].prior->sigma, 2);
  EXPECT_EQ(rules[kFx].lower, ParamRule().lower);
  EXPECT_EQ(rules[kFy].lower, 780);
  EXPECT_EQ(rules[kFy].upper, 800);
  EXPECT_EQ(rules[kCx].lower, 300);
  EXPECT_EQ(rules[kCx].upper, 340);
  EXPECT_FALSE(rules[kCx].prior);
  EXPECT_EQ(session.cameras[1].rules.size(), 4U) << "all cameras have rules when one has";
  const auto refused = [&](const std::string& keys) {
    return Refused("  a: {model: pinhole, images: a, " + keys + "}\n");
  };
  EXPECT_THAT(refused("bounds: {f_x: [800, 700]}"), HasSubstr("the lowest value first"));
  EXPECT_THAT(refused("bounds: {f_x: [800]}"), HasSubstr("expected [lowest, highest]"));
  EXPECT_THAT(refused("bounds: {f_x: [700, 800]}, initial: {f_x: 801}"),
              HasSubstr("the value in 'initial' of 'f_x', 801, is outside [700, 800]"));
  EXPECT_THAT(refused("bounds: {f_x: [700, 800]}, prior: {f_x: {value: 699, sigma: 1}}"),
              HasSubstr("the prior's value of 'f_x', 699, is outside [700, 800]"));
  EXPECT_EQ(refused("bounds: {f_x: [700, 800]}, initial: {f_x: 800}"), "no refusal");
  for (const char* rule : {"bounds: {f_x: [700, 800]}", "prior: {f_x: {value: 750, sigma: 1}}"}) {
    EXPECT_THAT(refused(std::string(rule) + ", initial: {f_x: 750}, fixed: [f_x]"),
                HasSubstr("'f_x' is fixed; remove it here or from 'fixed'"));
  }
  EXPECT_THAT(refused("prior: {f_z: {value: 750, sigma: 1}}"),
              HasSubstr("'f_z' is no parameter of model pinhole; did you mean 'f_x'?"));
}

TEST_F(SessionText, TiesParametersToTheEndOfAChain) {
  const Session session = Parse(
      "  a: {model: pinhole, images: a, initial: {f_y: 700}, fixed: [f_y], equal: [[f_x, f_y]]}\n"
      "  b: {model: pinhole, images: b, shared: {f_x: a}, equal: [[f_x, f_y]]}\n"
      "  c: {model: pinhole, images: c, shared: {f_x: b, c_y: a}}\n");
  const auto tied = [&](size_t camera, size_t param) {
    const auto& rule = session.cameras[camera].rules[param].tied_to;
    return rule ? std::pair(rule->camera, rule->param) : std::pair(size_t{9}, size_t{9});
  };
  const std::pair<size_t, size_t> root(0, kFx), none(9, 9);
  EXPECT_EQ(tied(0, kFx), none);
  EXPECT_EQ(tied(0, kFy), root);
  EXPECT_EQ(tied(1, kFx), root);
  EXPECT_EQ(tied(1, kFy), root) << "to b.f_x, which is tied to a.f_x";
  EXPECT_EQ(tied(2, kFx), root);
  EXPECT_EQ(tied(2, kFy), none);
  EXPECT_EQ(tied(2, kCy), std::pair(size_t{0}, size_t{kCy}));
  // What the session gives for one of them is of all.
  for (const auto& [camera, param] : {std::pair(0, kFx), {0, kFy}, {1, kFx}, {1, kFy}, {2, kFx}}) {
    EXPECT_EQ(session.cameras[static_cast<size_t>(camera)].initial[param], 700);
    EXPECT_TRUE(session.cameras[static_cast<size_t>(camera)].fixed[param]);
  }
  EXPECT_FALSE(session.cameras[2].fixed[kFy]);
  const auto refused = [&](const std::string& a, const std::string& b) {
    return Refused("  a: {model: pinhole, images: a, " + a +
                   "}\n  b: {model: pinhole, images: b, " + b + "}\n");
  };
  EXPECT_THAT(refused("shared: {f_x: b}", "shared: {f_x: a}"),
              HasSubstr("would be tied to itself"));
  EXPECT_THAT(refused("shared: {f_x: a}", "times: t"), HasSubstr("another camera of this session"));
  EXPECT_THAT(refused("equal: [[f_x]]", "times: t"), HasSubstr("two parameters or more"));
  EXPECT_THAT(refused("equal: [[f_x, f_x]]", "times: t"), HasSubstr("named twice"));
  EXPECT_THAT(refused("equal: [[f_x, f_y]]", "shared: {f_y: a}, equal: [[f_x, f_y]]"),
              HasSubstr("'f_y' is tied to another parameter already"));
  EXPECT_THAT(
      refused("initial: {f_x: 700}", "initial: {f_x: 701}, shared: {f_x: a}"),
      HasSubstr("'initial' of 'f_x' is 701, but that of 'a.f_x', to which it is tied, is 700"));
  EXPECT_THAT(refused("times: t", "bounds: {f_x: [1, 2]}, shared: {f_x: a}"),
              HasSubstr("'f_x' has no value of its own; give prior and bounds to 'a.f_x'"));
  EXPECT_THAT(Refused("  a: {model: pinhole-radtan, images: a, equal: [[f_x, k_1]]}\n"),
              HasSubstr("'k_1' (1) and 'f_x' (px) have different units"));
}

TEST_F(SessionText, HasTargetsAndTheirPoses) {
  const std::string camera = "  a: {model: pinhole, images: a}\n";
  EXPECT_EQ(Parse(camera).target.file, Path("target.yaml"));
  EXPECT_TRUE(Parse(camera, "target: chessboard:9x6:25mm\n").target.keys);
  EXPECT_TRUE(Parse(camera, "target: {type: chessboard}\n").target.keys);
  const Session one = Parse(camera, "targets: {floor: floor.yaml}\n");
  EXPECT_THAT(one.targets, IsEmpty());
  EXPECT_EQ(one.target.file, Path("floor.yaml"));
  const Session session = Parse(
      camera,
      "targets:\n"
      "  floor: floor.yaml\n"
      "  wall: {target: wall.yaml, pose: fixed}\n"
      "  cart: {target: cart.yaml, pose: free}\n"
      "  door: {target: door.yaml, pose: [[1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 1, 4], [0, 0, 0, 1]]}\n");
  ASSERT_EQ(session.targets.size(), 4U);
  EXPECT_EQ(session.target.file, Path("floor.yaml"));
  EXPECT_TRUE(session.targets[0].known) << "the frame of the known ones";
  EXPECT_FALSE(session.targets[1].known || session.targets[1].moves);
  EXPECT_TRUE(session.targets[2].moves);
  EXPECT_EQ(session.targets[3].known->t, Eigen::Vector3d(2, 3, 4));
  EXPECT_FALSE(Parse(camera, "targets: {floor: a.yaml, wall: b.yaml}\n").targets[0].known);
  const auto refused = [&](const std::string& lines) { return Refused(camera, lines); };
  EXPECT_THAT(refused("targets: {x: {target: x.yaml, pose: fix}, y: y.yaml}\n"),
              HasSubstr("did you mean 'fixed'?"));
  const std::string pose = "pose: [[1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 1, 4], [0, 0, 0, 1]]}";
  EXPECT_THAT(refused("targets: {x: {target: x.yaml, " + pose + ", y: y.yaml}\n"),
              HasSubstr("poses are given in the frame of this first target"));
  EXPECT_THAT(
      refused("targets: {x: {target: x.yaml, pose: free}, y: {target: y.yaml, " + pose + "}\n"),
      HasSubstr("which moves; name another first"));
  EXPECT_THAT(refused("targets: {a: x.yaml, y: y.yaml}\n"),
              HasSubstr("is the name of a camera too"));
  EXPECT_THAT(refused("target: t\ntargets: {x: x.yaml}\n"),
              HasSubstr("give either this or 'target'"));
  EXPECT_THAT(refused("target: t\nscene: {}\n"), HasSubstr("either 'target' or 'scene'"));
}

TEST_F(SessionText, HasOptions) {
  const std::string camera = "  a: {model: pinhole, images: a}\n";
  const auto with = [&](const std::string& options) {
    return Parse(camera, "target: t\noptions: {" + options + "}\n");
  };
  const Session usual = Parse(camera);
  EXPECT_EQ(usual.loss, Loss::kHuber);
  EXPECT_FALSE(usual.refine_target || usual.auto_refine || usual.frames || usual.all_frames);
  EXPECT_EQ(with("loss: cauchy").loss, Loss::kCauchy);
  EXPECT_EQ(with("loss: none").loss, Loss::kNone);
  EXPECT_EQ(with("refine_target: false").refine_target, false);
  EXPECT_TRUE(with("refine_target: auto").auto_refine);
  EXPECT_FALSE(with("refine_target: auto").refine_target);
  EXPECT_EQ(with("frames: 1").frames, 1U);
  EXPECT_TRUE(with("frames: all").all_frames);
  const auto refused = [&](const std::string& lines) { return Refused(camera, lines); };
  EXPECT_THAT(refused("target: t\noptions: {frames: 0}\n"), HasSubstr("1 or more"));
  EXPECT_THAT(refused("target: t\noptions: {loss: hubr}\n"), HasSubstr("did you mean 'huber'?"));
  EXPECT_THAT(refused("targets: {x: x, y: y}\noptions: {refine_target: auto}\n"),
              HasSubstr("with several 'targets' none is chosen"));
  EXPECT_THAT(refused("target: t\nextrinsics_only: true\n"),
              HasSubstr("a has no earlier calibration"));
}

TEST_F(SessionText, RefersToEarlierCalibrations) {
  Write("old.yaml", "");
  Write("camchain.yaml", "");
  const Session session = Parse(
      "  a: {model: pinhole, images: a, prior_from: [f_x, f_y], free: [c_x, extrinsics], fixed: [c_y]}\n"
      "  b: {model: pinhole, images: b, from: {file: camchain.yaml, format: kalibr}}\n",
      "target: t\nfrom: old.yaml\nextrinsics_only: true\n");
  EXPECT_EQ(session.from.path, Path("old.yaml"));
  EXPECT_EQ(session.from.format, "");
  EXPECT_TRUE(session.extrinsics_only);
  const EarlierParams& earlier = session.cameras[0].earlier;
  EXPECT_THAT(earlier.prior.value(), ElementsAre(kFx, kFy));
  EXPECT_THAT(earlier.free, ElementsAre(kCx));
  EXPECT_TRUE(earlier.free_extrinsics);
  EXPECT_TRUE(session.cameras[0].fixed[kCy]) << "its value is the earlier one";
  EXPECT_FALSE(session.cameras[0].initial[kCy]);
  EXPECT_EQ(session.cameras[1].from.path, Path("camchain.yaml"));
  EXPECT_EQ(session.cameras[1].from.format, "kalibr");
  EXPECT_FALSE(session.cameras[1].earlier.prior);
  EXPECT_FALSE(session.cameras[1].earlier.free_extrinsics);
  EXPECT_THAT(Refused("  a: {model: pinhole, images: a, free: [f_x]}\n"),
              HasSubstr("refers to an earlier calibration"));
  EXPECT_THAT(Refused("  a: {model: pinhole, images: a}\n", "target: t\nfrom: new.yaml\n"),
              HasSubstr("new.yaml: no such file"));
  EXPECT_THAT(Refused("  a: {model: auto, images: a}\n", "target: t\nfrom: old.yaml\n"),
              HasSubstr("state a model; with 'from' none is chosen"));
}

TEST_F(SessionText, HasRulesOfExclusion) {
  Session session = Parse("  a: {model: pinhole, images: a}\n",
                          "target: t\nexclude:\n"
                          "  - {camera: a, frame: '07', note: blurred}\n"
                          "  - {markers: [3, 5]}\n");
  ASSERT_EQ(session.exclude.size(), 2U);
  EXPECT_EQ(session.exclude[0].camera, "a");
  EXPECT_EQ(session.exclude[0].frame, "07");
  EXPECT_EQ(session.exclude[0].note, "blurred");
  EXPECT_THAT(session.exclude[0].markers, IsEmpty());
  EXPECT_EQ(session.exclude[1].camera, "");
  EXPECT_THAT(session.exclude[1].markers, ElementsAre(3, 5));
  const std::string before = session.text;
  AddExcludeRules({}, &session);
  EXPECT_EQ(session.text, before);
  AddExcludeRules({"frame: 'b*'", "markers: [9]"}, &session);
  ASSERT_EQ(session.exclude.size(), 4U);
  EXPECT_EQ(session.exclude[2].frame, "b*");
  EXPECT_EQ(
      session.text,
      before +
          "# excluded by the command line as well:\n#  - {frame: 'b*'}\n#  - {markers: [9]}\n");
  Session without = Parse("  a: {model: pinhole, images: a}\n");
  AddExcludeRules({"frame: c"}, &without);
  EXPECT_THAT(without.text, ::testing::EndsWith("exclude:\n  - {frame: c}\n"));
  EXPECT_THAT(ParseSession(without.text, without.path, CameraModels()).exclude,
              ElementsAre(::testing::Field(&ExcludeRule::frame, "c")));
  const auto refused = [&](const std::string& rule) {
    return testing::RefusalOf([&] { AddExcludeRules({rule}, &without); });
  };
  EXPECT_THAT(refused("camera: a"), HasSubstr("expected 'frame' (a name or glob), 'markers'"));
  EXPECT_THAT(refused("camera: b, frame: c"),
              HasSubstr("expected a camera of this session, got 'b'"));
  EXPECT_THAT(refused("markers: []"), HasSubstr("got an empty list"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
