// SPDX-License-Identifier: Apache-2.0
//
// The calibration problem of a session, with and without an earlier calibration.
#include "engine/session/calibration_input.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "engine/recording/messages/ros_messages.h"
#include "engine/session/earlier_session.h"
#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::StartsWith;

Target BoardOf(const std::string& more = {}) { return TargetOfWord("chessboard:4x3:30mm" + more); }

CameraInput CameraOf(const std::string& name, ImageSize size = {640, 480}) {
  const CameraModel* const model = FindModel(CameraModels(), "pinhole-radtan");
  return {.name = name,
          .model = model,
          .config = {},
          .initial = std::vector<std::optional<double>>(model->params.size()),
          .fixed = std::vector<bool>(model->params.size(), false),
          .image_size = size,
          .views = {}};
}

struct Made {
  CalibrationInput input = {};
  std::vector<std::string> messages = {};
};
Made Make(const Session& session, const Target& target, std::vector<CameraInput> cameras = {}) {
  Made made;
  plenocal::Run run;
  run.listener.message = [&](const std::string& line) { made.messages.push_back(line); };
  made.input = MakeCalibrationInput(session, target, std::move(cameras), run);
  return made;
}

TEST(CalibrationInputs, TakeWhatTheSessionStatesOfACamera) {
  SessionCamera camera;
  camera.name = "left";
  camera.model = FindModel(CameraModels(), "pinhole");
  camera.image_size = {320, 240};
  camera.image_circle = ImageCircle{{1, 2}, {3, 4}};
  camera.config = {5};
  camera.initial = {1.0, {}, 3.0, {}};
  camera.fixed = {true, false, false, true};
  camera.rules.resize(4);
  const CameraInput input = InputWithoutViews(camera);
  EXPECT_EQ(input.name, "left");
  EXPECT_EQ(input.model, camera.model);
  EXPECT_EQ(input.image_size, camera.image_size);
  EXPECT_EQ(input.image_circle->radii, Eigen::Vector2d(3, 4));
  EXPECT_EQ(input.config, camera.config);
  EXPECT_EQ(input.initial, camera.initial);
  EXPECT_EQ(input.fixed, camera.fixed);
  EXPECT_EQ(input.rules.size(), 4U);
  CameraInput other = CameraOf("right");
  UseSessionCamera(camera, &other);
  EXPECT_EQ(other.name, "right");
  EXPECT_EQ(other.image_size, (ImageSize{640, 480}));
  EXPECT_EQ(other.initial, camera.initial);
}

TEST(CalibrationInputs, HaveTheImagesSizeOfTheSession) {
  SessionCamera camera;
  camera.name = "left";
  CheckImageSize(camera, {640, 480});
  camera.image_size = {640, 480};
  CheckImageSize(camera, {640, 480});
  EXPECT_EQ(RefusalOf([&] {
              CheckImageSize(camera, {480, 640});
            }),
            "left: the images are 480 x 640 pixels, but the session states image_size 640 x 480");
}

TEST(CalibrationInputs, CountTheirObservations) {
  EXPECT_EQ(CountObservations({}), 0U);
  const std::vector<View> views{
      {"a", std::vector<Observation>(3)}, {"b", {}}, {"c", std::vector<Observation>(4)}};
  EXPECT_EQ(CountObservations(views), 7U);
}

TEST(CalibrationInputs, RefineMarkersByAHundredthOfTheirSpacing) {
  EXPECT_DOUBLE_EQ(RefinedMarkerFreedom(BoardOf()).Sigma(), 0.0003);
  EXPECT_DOUBLE_EQ(RefinedMarkerFreedom(BoardOf(":tolerance=0.2mm")).Sigma(), 0.0002);
  // The nearest other markers are 1, 1, 2, 3 and 4 m away.
  const Target markers = ReadTarget(YamlNode::Parse(
      "plenocal: 1\ntype: markers\nmarkers: {1: [0, 0, 0], 2: [1, 0, 0], 3: [3, 0, 0], 4: [6, 0, 0],"
      " 5: [3, 4, 0]}\n",
      "t"));
  EXPECT_DOUBLE_EQ(RefinedMarkerFreedom(markers).Sigma(), 0.02);
}

TEST(CalibrationInputs, RefineTheTargetWhereSessionOrTargetStateIt) {
  Session session;
  Made made = Make(session, BoardOf());
  EXPECT_TRUE(made.input.marker_freedom.IsRigid());
  EXPECT_THAT(
      made.messages,
      ElementsAre("the target states no tolerance, so it is held rigid; give it 'tolerance' "
                  "(m) to have its markers refined"));
  made = Make(session, BoardOf(":tolerance=0.2mm"));
  EXPECT_DOUBLE_EQ(made.input.marker_freedom.Sigma(), 0.0002);
  EXPECT_THAT(made.messages, IsEmpty());
  session.refine_target = true;
  made = Make(session, BoardOf());
  EXPECT_DOUBLE_EQ(made.input.marker_freedom.Sigma(), 0.0003);
  EXPECT_THAT(
      made.messages,
      ElementsAre("the target states no tolerance; its markers are refined with 0.3 mm, 1 % "
                  "of their spacing"));
  made = Make(session, BoardOf(":tolerance=0.2mm"));
  EXPECT_DOUBLE_EQ(made.input.marker_freedom.Sigma(), 0.0002);
  EXPECT_THAT(made.messages, IsEmpty());
  session.refine_target = false;
  made = Make(session, BoardOf(":tolerance=0.2mm"));
  EXPECT_TRUE(made.input.marker_freedom.IsRigid());
  EXPECT_THAT(made.messages, IsEmpty());
}

TEST(CalibrationInputs, LetMarkersMoveForScalesAndDistances) {
  Session session;
  session.refine_target = false;
  const double held = MarkerFreedom::Held().Sigma();
  Made made = Make(session, BoardOf(":scale_sigma=0.001"));
  EXPECT_EQ(made.input.marker_freedom.Sigma(), held);
  ASSERT_EQ(made.input.scales.size(), 1U);
  EXPECT_EQ(made.input.scales[0].sigma, 0.001);
  session.distances.push_back({{.name = "marker 1", .points = {1}},
                               {.name = "tag 2", .points = {4, 5, 6, 7}},
                               0.75,
                               0.002,
                               0,
                               YamlNode::Parse("1", "s")});
  made = Make(session, BoardOf());
  EXPECT_EQ(made.input.marker_freedom.Sigma(), held);
  ASSERT_EQ(made.input.distances.size(), 1U);
  const MarkerDistance& distance = made.input.distances[0];
  EXPECT_EQ(distance.name, "marker 1 to tag 2");
  EXPECT_THAT(distance.markers_a, ElementsAre(1));
  EXPECT_THAT(distance.markers_b, ElementsAre(4, 5, 6, 7));
  EXPECT_EQ(distance.length, 0.75);
  EXPECT_EQ(distance.sigma, 0.002);
  session.refine_target = true;
  EXPECT_DOUBLE_EQ(Make(session, BoardOf()).input.marker_freedom.Sigma(), 0.0003);
}

TEST(CalibrationInputs, HaveTargetLossAndCameras) {
  Session session;
  session.loss = Loss::kNone;
  session.targets.resize(2);
  const Made made = Make(session, BoardOf(), {CameraOf("left"), CameraOf("right")});
  EXPECT_EQ(made.input.markers.size(), 12U);
  EXPECT_EQ(made.input.loss, Loss::kNone);
  EXPECT_EQ(made.input.targets.size(), 2U);
  ASSERT_EQ(made.input.cameras.size(), 2U);
  EXPECT_EQ(made.input.cameras[1].name, "right");
}

TEST(CalibrationInputs, RefuseAnImageCircleBesideTheImage) {
  const auto refusal = [](const ImageCircle& circle) {
    CameraInput camera = CameraOf("left");
    camera.image_circle = circle;
    return RefusalOf([&] { Make({}, BoardOf(), {camera}); });
  };
  EXPECT_EQ(refusal({{640, 480}, {64, 48}}), "no refusal");
  EXPECT_EQ(refusal({{641, 240}, {300, 300}}),
            "left: the session's image_circle lies beside the image of 640 x 480 pixels, or covers "
            "hardly any of it; state [c_x, c_y, r_x, r_y] in px");
  EXPECT_THAT(refusal({{320, 240}, {63, 200}}), StartsWith("left: the session's image_circle"));
}

// ---- earlier calibrations

class EarlierCalibrations : public InTemporaryFolder {
 protected:
  EarlierCalibrations() {
    Write("calibration.yaml",
          "plenocal: 1\ncameras:\n" + Camera("left", 500) + Camera("right", 510));
    session_.path = Path("session.yaml");
    for (const char* name : {"left", "right"}) {
      SessionCamera& camera = session_.cameras.emplace_back();
      camera.name = name;
      camera.model = FindModel(CameraModels(), "pinhole");
      inputs_.push_back(CameraOf(name));
      inputs_.back().model = camera.model;
      inputs_.back().initial.assign(4, std::nullopt);
      inputs_.back().fixed.assign(4, false);
    }
  }
  static std::string Camera(const std::string& name, double focal) {
    const double x = name == "right" ? -0.1 : 0;
    return fmt::format(
        "  {}:\n    model: pinhole\n    image_size: [640, 480]\n"
        "    parameters: {{f_x: {}, f_y: {}, c_x: 320, c_y: 240}}\n"
        "    T_camera_rig: [[1, 0, 0, {}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n",
        name,
        focal,
        focal + 1,
        x);
  }
  std::string WriteRos(const std::string& file, const std::string& name) const {
    CameraInfo info{
        .size = {640, 480}, .distortion_model = "plumb_bob", .distortion = {0, 0, 0, 0, 0}};
    info.camera = {700, 0, 310, 0, 701, 230, 0, 0, 1};
    info.rectification = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    info.projection = {700, 0, 310, 0, 0, 701, 230, 0, 0, 0, 1, 0};
    return Write(file, RosCameraYaml(info, name)).string();
  }
  EarlierCameras Read() const { return ReadEarlierCameras(session_, inputs_, OpenParams::kFree); }
  [[nodiscard]] BuiltOnEarlier Build() const {
    return MakeInputOnEarlier(session_, BoardOf(), inputs_, {});
  }

  Session session_;
  std::vector<CameraInput> inputs_;
};

TEST_F(EarlierCalibrations, AreNoneWhereTheSessionNamesNone) {
  const BuiltOnEarlier built = Build();
  EXPECT_THAT(built.held, IsEmpty());
  EXPECT_FALSE(built.input.prior);
  EXPECT_FALSE(built.input.cameras[0].initial[0]);
  EXPECT_EQ(built.input.markers.size(), 12U);
}

TEST_F(EarlierCalibrations, GiveParametersAndExtrinsics) {
  session_.from.path = Path("calibration.yaml");
  const BuiltOnEarlier built = Build();
  EXPECT_EQ(built.input.cameras[0].initial[0], 500);
  EXPECT_EQ(built.input.cameras[1].initial[1], 511);
  ASSERT_EQ(built.input.earlier_T_camera_rig.size(), 2U);
  ASSERT_TRUE(built.input.earlier_T_camera_rig[1]);
  EXPECT_NEAR(built.input.earlier_T_camera_rig[1]->t.x(), -0.1, 1e-12);
  ASSERT_EQ(built.held.size(), 2U);
  EXPECT_EQ(built.held[1].code, "intrinsics_held");
  EXPECT_EQ(built.held[1].grade, Grade::kGood);
  EXPECT_THAT(built.held[1].cameras, ElementsAre("right"));
  EXPECT_EQ(built.held[1].what,
            "right: the parameters stay as the earlier calibration has them, which states no "
            "standard errors; the standard errors leave out theirs.");
  EXPECT_EQ(built.held[1].remedy,
            "Give a calibration of plenocal with its correlations.csv as 'from', without "
            "'extrinsics_only', to have them in.");
  session_.extrinsics_only = true;
  EXPECT_EQ(Build().held[0].what,
            "left: the parameters stay as the earlier calibration has them (extrinsics_only); the "
            "standard errors leave out theirs.");
  EXPECT_TRUE(Build().input.cameras[0].fixed[0]);
}

TEST_F(EarlierCalibrations, OfACameraGoBeforeThatOfTheSession) {
  session_.from.path = Path("calibration.yaml");
  session_.cameras[1].from.path =
      Write("own.yaml", "plenocal: 1\ncameras:\n" + Camera("only", 333));
  const EarlierCameras cameras = Read();
  EXPECT_EQ(cameras.inputs[0].initial[0], 500);
  EXPECT_EQ(cameras.inputs[1].initial[0], 333);
}

TEST_F(EarlierCalibrations, OfOtherToolsGetTheCamerasNames) {
  // Without distortion they are of the model pinhole.
  session_.cameras[1].from = {WriteRos("a.yaml", "narrow"), "ros"};
  EarlierCameras cameras = Read();
  EXPECT_FALSE(cameras.inputs[0].initial[0]);
  EXPECT_EQ(cameras.inputs[1].initial[0], 700);
  EXPECT_EQ(cameras.inputs[1].initial[1], 701);
  EXPECT_EQ(cameras.inputs[1].initial[2], 310);
  // Of a file for two cameras the names are those in it.
  session_.cameras[1].from = {};
  session_.from = {WriteRos("b.yaml", "right"), "ros"};
  cameras = Read();
  EXPECT_FALSE(cameras.inputs[0].initial[0]);
  EXPECT_EQ(cameras.inputs[1].initial[0], 700);
  session_.from = {Path("a.yaml"), "rso"};
  EXPECT_THAT(RefusalOf([&] { Read(); }),
              StartsWith(Path("a.yaml").string() +
                         ": 'format' is 'rso', which is none; did you mean 'ros'?"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
