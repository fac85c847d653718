// SPDX-License-Identifier: Apache-2.0
//
// The choice of frames among stated points: motion, blur, appearance and information.
#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <numeric>

#include "assess/frames/frame_selection.h"
#include "assess/views/rig_estimate.h"
#include "calib/estimate/describe.h"
#include "calib/start/camera_guess.h"
#include "engine/observe/choose_frames.h"
#include "engine/session/calibration_input.h"
#include "engine/session/memory_session.h"
#include "engine/suggest/view_target.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/engine/observe/earlier_detections.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

constexpr const char* kBoard = "chessboard:4x3:40mm";

using Frames = std::vector<std::pair<std::string, FoundInImage>>;

struct Made {
  FrameChoice choice;
  std::vector<std::string> messages, stages;
  std::vector<CameraImages> cameras;
  std::vector<std::string> rows;  // of the table, without its head
};

Session SessionOf(size_t cameras, std::optional<size_t> frames) {
  Session session;
  for (size_t c = 0; c < cameras; ++c) {
    SessionCamera& camera = session.cameras.emplace_back();
    camera.name = c == 0 ? "left" : "right";
    camera.model = FindModel(CameraModels(), "pinhole");
  }
  session.frames = frames;
  return session;
}

Made Choose(Session session, const std::vector<Frames>& found) {
  EarlierDetections earlier;
  Made made;
  for (size_t c = 0; c < found.size(); ++c) {
    session.cameras[c].initial.resize(4);
    session.cameras[c].fixed.resize(4);
    made.cameras.push_back({earlier.Images(session.cameras[c].name, found[c]), {}});
  }
  plenocal::Run run;
  run.threads = 1;
  run.listener.message = [&](const std::string& line) { made.messages.push_back(line); };
  run.listener.progress = [&](const std::string& stage, size_t done, size_t total) {
    made.stages.push_back(total == 0 ? stage : fmt::format("{} {}/{}", stage, done, total));
  };
  made.choice = ChooseFrames(session, TargetOfWord(kBoard), &earlier.cache, run, &made.cameras);
  std::istringstream table(made.choice.table);
  std::string line;
  std::getline(table, line);
  EXPECT_EQ(line, "frame,chosen,motion,blur,points,reason");
  while (std::getline(table, line)) made.rows.push_back(line);
  return made;
}

// Names of the frames that are chosen, in the table's order.
std::vector<std::string> Chosen(const Made& made) {
  std::vector<std::string> names;
  for (const std::string& row : made.rows) {
    const size_t comma = row.find(',');
    if (row[comma + 1] == '1') names.push_back(row.substr(0, comma));
  }
  return names;
}

// Eight points about (x, y), twice as often where `twice`, of no marker of the
// target: no calibration from them.
std::vector<Observation> Ring(double x, double y, bool twice = false) {
  std::vector<Observation> points;
  for (int k = 0; k < (twice ? 16 : 8); ++k) {
    const double angle = k * std::atan(1.0);
    points.push_back(PointAt(1000 + k, x + 100 * std::cos(angle), y + 100 * std::sin(angle)));
  }
  return points;
}

FoundInImage In(std::vector<Observation> points, double blur = 0) {
  return {.points = std::move(points), .blur = blur};
}

constexpr const char* kAlike = "looks like frames that are chosen";

TEST(FrameChoice, ListsMotionBlurPointsAndReasons) {
  std::vector<Observation> few = Ring(300, 200), other = Ring(500, 500);
  few.resize(5);
  for (Observation& point : other) point.marker += 100;
  std::vector<Observation> six = Ring(0, 0);
  six.resize(6);
  // Frames in another order than their names; c and h follow each other in the right camera.
  const Frames left{{"b", In(Ring(300, 200), 1.5)},
                    {"a", In(Ring(303, 204), 1)},
                    {"c", In(Ring(303, 216), 0.5)},
                    {"d", {.why = "is dark, \"black\""}},
                    {"e", In(few, 2)},
                    {"f", In({})},
                    {"g", In(other)}};
  const Frames right{{"c", In(Ring(100, 100), 0.75)}, {"h", In(six, 0.25)}, {"i", {.why = "gone"}}};
  const Made made = Choose(SessionOf(2, 6), {left, right});
  EXPECT_EQ(made.messages.front(),
            "9 frames: at most 6 of them are chosen (--all keeps all, --frames another number)");
  EXPECT_THAT(made.messages[1], StartsWith("frames are chosen by coverage alone: "));
  EXPECT_THAT(made.messages.back(),
              "5 of 9 frames are chosen (reasons for the others: chosen_frames.csv)");
  EXPECT_THAT(made.stages,
              ElementsAre("left: look for the target 1/7",
                          "left: look for the target 2/7",
                          "left: look for the target 3/7",
                          "left: look for the target 4/7",
                          "left: look for the target 5/7",
                          "left: look for the target 6/7",
                          "left: look for the target 7/7",
                          "right: look for the target 1/3",
                          "right: look for the target 2/3",
                          "right: look for the target 3/3",
                          "first calibration"));
  // c moves 12 px in the left camera and to six points 141 px away in the right one.
  EXPECT_THAT(made.rows,
              ElementsAre("a,1,12,1,8,",
                          "b,1,5,1.5,8,",
                          "c,1,141,0.75,16,",
                          "d,0,,,0,\"is dark, \"\"black\"\"\"",
                          "e,0,,2,5,shows too few points of the target",
                          "f,0,,,0,shows too few points of the target",
                          "g,1,,0,8,",
                          "h,1,141,0.25,6,",
                          "i,0,,,0,gone"));
  ASSERT_THAT(made.choice.left_out, SizeIs(4));
  EXPECT_EQ(made.choice.left_out[0].where, "left/d");
  EXPECT_EQ(made.choice.left_out[0].camera, "left");
  EXPECT_EQ(made.choice.left_out[0].frame, "d");
  EXPECT_EQ(made.choice.left_out[0].reason, "is dark, \"black\"");
  EXPECT_TRUE(made.choice.left_out[0].whole);
  EXPECT_EQ(made.choice.left_out[3].where, "right/i");
  EXPECT_EQ(made.choice.left_out[3].camera, "right");
  EXPECT_THAT(made.cameras[0].images, SizeIs(4));
  EXPECT_THAT(made.cameras[1].images, SizeIs(2));
}

TEST(FrameChoice, KeepsExcludedFramesOutOfIt) {
  Session session = SessionOf(2, 2);
  session.exclude = {{.camera = "left", .frame = "b"}, {.frame = "c"}};
  const Frames left{{"a", In(Ring(1, 1))}, {"b", In(Ring(2, 2))}, {"c", In(Ring(3, 3))}};
  const Frames right{{"b", In(Ring(5, 5))}, {"c", In(Ring(6, 6))}};
  const Made made = Choose(session, {left, right});
  // b is one of the right camera alone.
  EXPECT_THAT(made.rows, ElementsAre("a,1,1.41,0,8,", "b,1,1.41,0,8,"));
  EXPECT_THAT(made.cameras[0].images, SizeIs(3));
  EXPECT_THAT(made.cameras[1].images, SizeIs(2));
  EXPECT_THAT(made.choice.left_out, IsEmpty());
}

TEST(FrameChoice, WorksWithoutImagesOfACamera) {
  const Frames left{{"a", In(Ring(1, 1))}, {"b", In(Ring(2, 2))}, {"c", In(Ring(9, 2))}};
  const Frames right{{"a", In(Ring(5, 5))}, {"b", In(Ring(6, 6))}, {"c", In(Ring(99, 6))}};
  EXPECT_THAT(Chosen(Choose(SessionOf(2, 2), {left, {}})), ElementsAre("a", "c"));
  EXPECT_THAT(Chosen(Choose(SessionOf(2, 2), {{}, right})), ElementsAre("a", "c"));
}

double UpperMedian(std::vector<double> values) {
  std::ranges::sort(values);
  return values[values.size() / 2];
}

// Of each four that follow each other one is kept, by motion and blur over their medians.
TEST(FrameChoice, OfFramesThatFollowEachOtherTakesTheOneAtRest) {
  constexpr size_t kCount = 43, kWindow = 4;  // 43 / (5 x 2)
  Random random(3);
  std::vector<double> x{0}, blur, motion(kCount), known;
  Frames frames;
  for (size_t k = 0; k < kCount; ++k) {
    if (k > 0) x.push_back(x.back() + random.Uniform(1, 20));
    blur.push_back(k % 3 == 1 ? 0 : random.Uniform(0.2, 4));
    std::vector<Observation> points = Ring(x[k], 0);
    // Frames 20 and 21 have no points in common with others.
    for (Observation& point : points) point.marker += k == 20 ? 50 : k == 21 ? 80 : 0;
    frames.emplace_back(fmt::format("{:02}", k), In(points, blur[k]));
  }
  std::vector<double> motions, blurs;
  const auto alone = [](size_t k) { return k == 20 || k == 21; };
  for (size_t k = 0; k < kCount; ++k) {
    motion[k] = std::nan("");
    for (const size_t other : {k - 1, k + 1}) {
      if (other >= kCount || alone(k) || alone(other)) continue;
      const double moved = std::abs(x[k] - x[other]);
      motion[k] = std::isnan(motion[k]) ? moved : std::max(motion[k], moved);
    }
    if (!alone(k)) motions.push_back(motion[k]);
    if (blur[k] > 0) blurs.push_back(blur[k]);
  }
  const auto unrest = [&](size_t k) {
    const double usual = UpperMedian(motions);
    return (alone(k) ? usual : motion[k]) / usual + blur[k] / UpperMedian(blurs);
  };
  const Made made = Choose(SessionOf(1, 2), {frames});
  ASSERT_THAT(made.rows, SizeIs(kCount));
  for (size_t begin = 0; begin < kCount; begin += kWindow) {
    const size_t end = std::min(begin + kWindow, kCount);
    size_t best = begin;
    for (size_t k = begin; k < end; ++k) {
      if (unrest(k) < unrest(best)) best = k;
    }
    for (size_t k = begin; k < end; ++k) {
      const std::string beside =
          fmt::format("moves more or is less sharp than frame {:02} beside it", best);
      if (k == best) {
        EXPECT_THAT(made.rows[k], ::testing::Not(HasSubstr("moves more"))) << k;
      } else {
        EXPECT_THAT(made.rows[k], ::testing::EndsWith(beside)) << k;
      }
    }
  }
  EXPECT_THAT(Chosen(made), SizeIs(2));
  EXPECT_THAT(made.messages.back(), StartsWith("2 of 43 frames "));
}

// Motion in pixels and blur count against their usual size: 1 where none is known.
TEST(FrameChoice, WithoutUsualSizesTakesTheSharpest) {
  Frames frames;
  for (int k = 0; k < 10; ++k) {
    std::vector<Observation> points = Ring(k, 0);
    for (Observation& point : points) point.marker += 100 * k;
    frames.emplace_back(std::to_string(k), In(points, k % 2 == 0 ? 0.5 : 0.25));
  }
  Made made = Choose(SessionOf(1, 1), {frames});
  for (size_t k = 0; k < 10; k += 2) EXPECT_THAT(made.rows[k], HasSubstr("moves more")) << k;
  for (auto& [name, in_image] : frames) in_image.blur = 0;
  made = Choose(SessionOf(1, 1), {frames});
  for (size_t k = 1; k < 10; k += 2) EXPECT_THAT(made.rows[k], HasSubstr("moves more")) << k;
}

using Change = std::function<void(double* x, double* y)>;

std::vector<Observation> Changed(const Change& change, bool twice = false) {
  std::vector<Observation> points = Ring(0, 0, twice);
  for (Observation& point : points) {
    double x = point.values[0], y = point.values[1];
    change(&x, &y);
    point.values[0] = 320 + x;
    point.values[1] = 240 + y;
  }
  return points;
}

// Whether a change of the appearance counts as a shift by this part of the image's width, within
// `within` of it: of two frames the more different one is chosen beside the first.
void ExpectDifference(const Change& change,
                      double expected,
                      double within = 0.02,
                      bool down = false) {
  const auto same = [](double*, double*) {};
  for (const double factor : {1 - within, 1 + within}) {
    const double shift = 640 * expected * factor;
    const auto shifted = [&](double* x, double* y) { *(down ? y : x) += shift; };
    Frames frames{{"first", In(Changed(same, true))},
                  {"changed", In(Changed(change))},
                  {"shifted", In(Changed(shifted))}};
    EXPECT_THAT(Chosen(Choose(SessionOf(1, 2), {frames})),
                ::testing::Contains(factor < 1 ? "changed" : "shifted"))
        << expected << " " << factor;
    // In the second of two cameras, the other way round.
    const Frames plain{{"first", In(Changed(same, true))},
                       {"changed", In(Changed(same))},
                       {"shifted", In(Changed(same))}};
    std::swap(frames[1].first, frames[2].first);
    EXPECT_THAT(Chosen(Choose(SessionOf(2, 2), {plain, frames})),
                ::testing::Contains(factor < 1 ? "shifted" : "changed"));
  }
}

TEST(FrameAppearance, IsCentreSizeAndShape) {
  ExpectDifference([](double* x, double* y) { *x += 60, *y -= 80; }, 100.0 / 640);
  ExpectDifference([](double* x, double* y) { *x += 60, *y -= 80; }, 100.0 / 640, 0.02, true);
  ExpectDifference([](double* x, double* y) { *x *= 1.5, *y *= 1.5; }, std::log(1.5) / 2);
  ExpectDifference([](double* x, double* y) { *x *= 1.25, *y /= 1.25; }, std::log(1.25));
  ExpectDifference([](double* x, double* y) { *x /= 1.25, *y *= 1.25; }, std::log(1.25));
  // Both coordinates spread as much as before, with a correlation of 0.6 and -0.6.
  ExpectDifference([](double* x, double* y) { *y = 0.6 * *x + 0.8 * *y; }, 0.3);
  ExpectDifference([](double* x, double* y) { *x = -0.6 * *y + 0.8 * *x; }, 0.3);
}

TEST(FrameAppearance, OfALineIsFinite) {
  const double spread = 100 / std::sqrt(2) / 640;  // of each coordinate before
  ExpectDifference([](double* x, double*) { *x = 0; },
                   std::hypot((std::log(1e-12) - std::log(spread * spread)) / 4,
                              std::log(1e-9 / (spread + 1e-9)) / 2),
                   0.005);
  ExpectDifference([](double*, double* y) { *y = 0; },
                   std::hypot((std::log(1e-12) - std::log(spread * spread)) / 4,
                              std::log((spread + 1e-9) / 1e-9) / 2),
                   0.005);
}

// Each next one is the most different from those before, beginning with most points.
TEST(FrameChoice, ByCoverageTakesTheMostDifferent) {
  const auto at = [](const char* name, double x, bool twice = false) {
    return std::pair(std::string(name), In(Ring(x, 0, twice)));
  };
  Frames frames{at("near", 90), at("end", 100), at("most", 0, true), at("middle", 40)};
  // Six points are enough; those of a hexagon spread as those of an octagon do.
  std::vector<Observation>& six = frames[0].second.points;
  six.resize(6);
  for (size_t k = 0; k < 6; ++k) {
    const double angle = static_cast<double>(k) * std::acos(0.5);
    six[k] = PointAt(1000 + static_cast<int>(k), 90 + 100 * std::cos(angle), 100 * std::sin(angle));
  }
  const auto chosen = [&](size_t count) { return Chosen(Choose(SessionOf(1, count), {frames})); };
  EXPECT_THAT(chosen(1), ElementsAre("most"));
  EXPECT_THAT(chosen(2), ElementsAre("end", "most"));
  const Made made = Choose(SessionOf(1, 3), {frames});
  EXPECT_THAT(Chosen(made), ElementsAre("end", "middle", "most"));

  for (const std::string& row : made.rows) {
    EXPECT_EQ(row.ends_with(kAlike), row.starts_with("near"));
  }
  // The first of two with as many points.
  EXPECT_THAT(Chosen(Choose(SessionOf(1, 1), {{at("a", 0), at("b", 5), at("c", 9)}})),
              ElementsAre("a"));
  // All are different frames where none looks different.
  EXPECT_THAT(Chosen(Choose(SessionOf(1, 2), {{at("a", 0), at("b", 0), at("c", 0)}})), SizeIs(2));
}

// Views of a board by a pair; the left camera misses some frames, and has few points in others.
class FrameInformation : public ::testing::Test {
 protected:
  FrameInformation() {
    Random random(5);
    const Target board = TargetOfWord(kBoard);
    for (size_t frame = 0; frame < kFrames; ++frame) {
      const RigidTransform T{
          ExpRotation(random.Uniforms<3>(-0.5, 0.5)),
          {random.Uniform(-0.15, 0.05), random.Uniform(-0.12, 0.02), random.Uniform(0.35, 0.9)}};
      for (size_t c = 0; c < 2; ++c) {
        if (c == 0 && frame % 5 == 3) continue;
        const RigidTransform T_camera_target = c == 0 ? T : kRight * T;
        FoundInImage found;
        for (const auto& [marker, position] : board.markers) {
          const Eigen::Vector3d p = T_camera_target * position;
          found.points.push_back(PointAt(marker,
                                         320 + 500 * p.x() / p.z() + random.Gaussian(0.1),
                                         240 + 500 * p.y() / p.z() + random.Gaussian(0.1)));
        }
        // Six are enough.
        if (c == 0 && frame % 5 == 1) found.points.resize(frame == 6 ? 6 : 5);
        found_[c].emplace_back(fmt::format("{:02}", frame), std::move(found));
      }
    }
  }

  // The choice by the uncertainty that is left, from a calibration of all frames.
  [[nodiscard]] FrameSelection Expected(const Session& session, size_t wanted) const {
    const Target board = TargetOfWord(kBoard);
    std::vector<CameraInput> inputs;
    for (size_t c = 0; c < 2; ++c) {
      CameraInput& input = inputs.emplace_back(InputWithoutViews(session.cameras[c]));
      input.image_size = {640, 480};
      for (const auto& [frame, found] : found_[c]) {
        if (found.points.size() >= 6) input.views.push_back({frame, found.points});
      }
    }
    const RigEstimate rig =
        MakeRigEstimate(Describe(Calibrate(MakeCalibrationInput(session, board, inputs, {}), {})));
    std::vector<RigidTransform> poses;
    for (size_t frame = 0; frame < kFrames; ++frame) {
      for (size_t c = 0; c < 2; ++c) {
        const auto view =
            std::ranges::find(inputs[c].views, fmt::format("{:02}", frame), &View::frame);
        if (view == inputs[c].views.end()) continue;
        const BundleCamera& camera = rig.bundle.cameras[c];
        poses.push_back(camera.T_camera_rig.Inverse() *
                        GuessPose(camera, *view, board.markers).value());
        break;
      }
    }
    return SelectFrames(rig, MakeViewTarget(board), poses, wanted, 1);
  }

  static constexpr size_t kFrames = 14;
  const RigidTransform kRight{ExpRotation({0.01, 0.1, -0.02}), {-0.1, 0.01, 0.02}};
  std::vector<Frames> found_{{}, {}};
};

TEST_F(FrameInformation, DecidesWhereItIsKnown) {
  Session session = SessionOf(2, 5);
  for (SessionCamera& camera : session.cameras) {
    camera.initial.resize(4);
    camera.fixed.resize(4);
  }
  const FrameSelection expected = Expected(session, 5);
  ASSERT_THAT(expected.chosen, SizeIs(5));
  std::vector<std::string> names;
  for (const size_t i : expected.chosen) names.push_back(fmt::format("{:02}", i));
  std::ranges::sort(names);
  const Made made = Choose(session, found_);
  EXPECT_EQ(Chosen(made), names);
  EXPECT_THAT(made.messages, SizeIs(2));
  EXPECT_EQ(made.messages[1],
            "5 of 14 frames are chosen (reasons for the others: chosen_frames.csv)");
  EXPECT_EQ(made.stages[made.stages.size() - 2], "first calibration");
  EXPECT_EQ(made.stages.back(), "information of the frames");
  const std::string why = fmt::format(
      "\"adds little: the frames chosen are expected to give a standard error of the projection of "
      "{:.2g} px, all 14 candidates {:.2g} px\"",
      expected.sigma.back(),
      expected.sigma_of_all);
  for (const std::string& row : made.rows) {
    if (row[3] == '0') {
      EXPECT_TRUE(row.ends_with(why)) << row;
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
