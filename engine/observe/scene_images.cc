// SPDX-License-Identifier: Apache-2.0
#include "engine/observe/scene_images.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <set>
#include <string>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "calib/estimate/start_bundle.h"
#include "calib/files/exclusion.h"
#include "calib/files/frame_images.h"
#include "detectors/detect.h"
#include "detectors/images/image.h"
#include "detectors/images/opencv_threads.h"
#include "engine/observe/left_out.h"
#include "engine/observe/scene_session.h"
#include "engine/recording/frames/session_frames.h"
#include "engine/recording/stores/image_index.h"
#include "engine/recording/stores/image_lister.h"
#include "engine/scene/track/follow_points.h"
#include "engine/session/calibration_input.h"
#include "targets/target.h"

namespace plenocal {
namespace {

// The images of one camera.
struct SceneCameraImages {
  std::vector<FrameImage> images;
  ImageSize size{};  // of the first that can be read
};

class SceneImageFollower {
 public:
  SceneImageFollower(const Session& session, const Run& run)
      : session_(session), run_(run), exclusion_(session.exclude), images_(session.cameras.size()) {
    UseNoOpenCvThreads();
  }

  SceneObservations Follow() {
    std::vector<std::string> notes;
    std::vector<std::vector<FrameImage>> images = ListSessionImages(session_, &notes);
    for (const std::string& note : notes) run_.Message(note);
    for (size_t c = 0; c < images_.size(); ++c) TakeImages(c, std::move(images[c]));
    NameFrames();
    MakeCameras();
    RigImages rig{.cameras = &cameras_,
                  .optics = MeasureOptics(),
                  .frames = frames_,
                  .read = [this](size_t camera, size_t frame) { return Read(camera, frame); },
                  .threads = run_.threads};
    std::vector<size_t> all(frames_.size());
    for (size_t i = 0; i < all.size(); ++i) all[i] = i;
    FollowedPoints points =
        FollowPoints(rig,
                     all,
                     {.wanted = session_.scene->points, .calibrated = calibrated_},
                     0,
                     [&](size_t done, size_t total) {
                       if (!run_.Progress("follow points: images", done, total)) throw Stopped();
                     });
    result_.alike = std::move(points.alike);
    Append(std::move(points.left_out));
    if (session_.scene->tags) FindTags(&points);
    for (size_t c = 0; c < images_.size(); ++c) AddCamera(c, rig, &points);
    for (const std::string& line : GroupedByReason(result_.session.left_out)) {
      run_.Message("  " + line);
    }
    for (const std::string& rule : exclusion_.Unused()) run_.Message(rule);
    return std::move(result_);
  }

 private:
  void Append(std::vector<LeftOut> items) {
    std::vector<LeftOut>& all = result_.session.left_out;
    all.insert(all.end(), items.begin(), items.end());
  }

  void TakeImages(size_t c, std::vector<FrameImage> images) {
    const SessionCamera& camera = session_.cameras[c];
    SceneCameraImages& of = images_[c];
    of.images = std::move(images);
    exclusion_.RemoveImages(camera.name, &of.images, &result_.session.left_out);
    std::string failure = "the session's 'exclude' leaves out all images; take back a rule";
    for (const FrameImage& image : of.images) {
      try {
        const cv::Mat read = ReadImage(image);
        of.size = {read.cols, read.rows};
        break;
      } catch (const Error& error) {
        if (failure.empty() || of.images.front().path == image.path) failure = error.what();
      }
    }
    if (of.size == ImageSize{}) {
      throw InputError("{}: {}", camera.name, failure);
    }
    CheckImageSize(camera, of.size);
  }

  void NameFrames() {
    images_of_.resize(images_.size());
    for (size_t c = 0; c < images_.size(); ++c) {
      for (const FrameImage& image : images_[c].images) {
        images_of_[c].emplace(image.frame, image);
        frames_.push_back(image.frame);
      }
    }
    std::ranges::sort(frames_, NaturalLess);
    frames_.erase(std::unique(frames_.begin(), frames_.end()), frames_.end());
  }

  // With what the session and an earlier calibration give.
  void MakeCameras() {
    std::vector<CameraInput> inputs;
    for (size_t c = 0; c < images_.size(); ++c) {
      inputs.push_back(InputWithoutViews(session_.cameras[c]));
      inputs.back().image_size = images_[c].size;
    }
    const EarlierCameras known = MakeSceneInput(session_, inputs).cameras;
    calibrated_ = true;
    for (size_t c = 0; c < inputs.size(); ++c) {
      const CameraInput& input = known.inputs[c];
      const bool has_all =
          std::ranges::all_of(input.initial, [](const auto& value) { return value.has_value(); });
      std::vector<double> params(input.initial.size(), 0);
      if (has_all) {
        for (size_t k = 0; k < params.size(); ++k) params[k] = *input.initial[k];
      }
      CameraInput alone = input;
      alone.rules.clear();
      cameras_.push_back(MakeBundleCamera(alone, std::move(params)));
      if (known.T_camera_rig[c]) cameras_.back().T_camera_rig = *known.T_camera_rig[c];
      if (input.model->plenoptic) continue;
      calibrated_ = calibrated_ && has_all && known.T_camera_rig[c].has_value();
    }
  }

  std::map<size_t, PlenopticCamera> MeasureOptics() {
    std::map<size_t, PlenopticCamera> optics;
    for (size_t c = 0; c < images_.size(); ++c) {
      const SessionCamera& camera = session_.cameras[c];
      if (!camera.model->plenoptic) continue;
      if (camera.white_images.empty()) {
        throw InputError(
            "{}: cameras.{}: a plenoptic camera needs white_images: the "
            "micro-image centres come from them",
            session_.path.string(),
            camera.name);
      }
      const std::vector<FrameImage> white =
          ListImages(camera.white_images, camera.name + ": white_images");
      optics.emplace(
          c, MeasurePlenopticCamera(white, camera.bayer, run_.threads, &result_.session.left_out));
    }
    return optics;
  }

  [[nodiscard]] cv::Mat Read(size_t camera, size_t frame) const {
    const auto found = images_of_[camera].find(frames_[frame]);
    if (found == images_of_[camera].end()) return {};
    cv::Mat image = session_.cameras[camera].model->plenoptic ? ReadImage(found->second)
                                                              : ReadGray(found->second);
    const ImageSize size = images_[camera].size;
    if (image.cols == size[0] && image.rows == size[1]) return image;
    throw InputError("is {} x {} pixels, while the camera's images are {} x {}",
                     image.cols,
                     image.rows,
                     size[0],
                     size[1]);
  }

  // Corners of the scene's tags as points of their own, in the ordinary cameras.
  void FindTags(FollowedPoints* points) {
    const SceneTags& tags = *session_.scene->tags;
    std::set<int> seen;
    for (size_t i = 0; i < tags.ids.size(); ++i) {
      const int id = tags.ids[i];
      const Target target = TargetOfTag(tags, id);
      for (size_t c = 0; c < images_.size(); ++c) {
        if (session_.cameras[c].model->plenoptic) continue;
        const size_t count = images_[c].images.size();
        const ImageDetections found = DetectImages(
            images_[c].images,
            target,
            CameraOptics::kOrdinary,
            {.threads = run_.threads, .progress = [&](size_t done) {
               return run_.Progress(fmt::format("find tag {}: images", id), done, count);
             }});
        if (!found.views.empty()) seen.insert(id);
        for (const View& view : found.views) AddTag(id, view, &points->views[c]);
      }
    }
    run_.Message(fmt::format("{} of {} found", seen.size(), Counted(tags.ids.size(), "tag")));
  }

  // Detections of one tag; its position is unknown.
  [[nodiscard]] Target TargetOfTag(const SceneTags& tags, int id) const {
    const std::string text = fmt::format(
        "plenocal: 1\ntype: apriltag\n{}\ntags: [{{id: {}, corners: [[0, 0, 0], [1, 0, 0], [1, 1, 0], "
        "[0, 1, 0]]}}]\n",
        tags.node.Dump({"ids", "size", "size_sigma"}),
        id);
    return ReadTarget(YamlNode::Parse(text, session_.path.string() + ": scene.tags"));
  }

  static void AddTag(int id, const View& tag, std::vector<View>* views) {
    auto view = std::ranges::find(*views, tag.frame, &View::frame);
    if (view == views->end()) view = views->insert(view, {.frame = tag.frame, .observations = {}});
    for (Observation seen : tag.observations) {
      seen.marker = TagPoint(id, seen.marker % 4);
      view->observations.push_back(seen);
    }
  }

  void AddCamera(size_t c, const RigImages& rig, FollowedPoints* points) {
    const SessionCamera& camera = session_.cameras[c];
    CameraInput input = InputWithoutViews(camera);
    input.image_size = images_[c].size;
    input.views = std::move(points->views[c]);
    exclusion_.RemoveViews(camera.name, images_[c].images, &input.views, &result_.session.left_out);
    run_.Message(fmt::format("{}: {}, points followed in {}, {}",
                             camera.name,
                             Counted(images_[c].images.size(), "image"),
                             input.views.size(),
                             Counted(CountObservations(input.views), "observation")));
    if (const auto optics = rig.optics.find(c); optics != rig.optics.end()) {
      result_.session.files.push_back({c,
                                       "micro_lenses",
                                       fmt::format("micro_lenses_{}.csv", camera.name),
                                       FormatMicroLenses(optics->second.array)});
      input.lattice_errors = optics->second.array.errors;
      result_.session.files.push_back({c,
                                       "lattice",
                                       fmt::format("lattice_{}.yaml", camera.name),
                                       FormatLatticeErrors(input.lattice_errors)});
      result_.session.files.push_back({c,
                                       "vignetting",
                                       fmt::format("vignetting_{}.tiff", camera.name),
                                       EncodeImage(".tiff", optics->second.attenuation)});
    }
    result_.session.sample_frames.emplace_back();
    result_.session.traits.emplace_back();
    result_.session.blurs.emplace_back();
    result_.session.cameras.push_back(std::move(input));
  }

  const Session& session_;
  const Run& run_;
  Exclusion exclusion_;
  std::vector<SceneCameraImages> images_;
  std::vector<std::map<std::string, FrameImage>> images_of_;  // per camera, by frame
  std::vector<std::string> frames_;
  std::vector<BundleCamera> cameras_;
  bool calibrated_ = true;
  SceneObservations result_;
};

}  // namespace

bool FollowsImages(const Session& session) {
  const auto has_images = [](const SessionCamera& camera) { return HasImages(camera); };
  if (std::ranges::all_of(session.cameras, has_images)) return true;
  const auto camera = std::ranges::find_if(session.cameras, has_images);
  if (camera == session.cameras.end()) return false;
  throw InputError(
      "{}: cameras.{} has images, other cameras have tracks, whose numbers mean "
      "other points; give all cameras images or all 'detections'",
      session.path.string(),
      camera->name);
}

SceneObservations FollowSceneImages(const Session& session, const Run& run) {
  return SceneImageFollower(session, run).Follow();
}

}  // namespace plenocal
