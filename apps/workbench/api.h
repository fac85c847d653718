// SPDX-License-Identifier: Apache-2.0
//
// Answers the page's requests, from parsing to JSON.
#pragma once

#include <atomic>
#include <filesystem>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/workbench/http/guard.h"
#include "apps/workbench/live_look.h"
#include "apps/workbench/project/jobs.h"
#include "apps/workbench/project/project.h"
#include "apps/workbench/project/session_images.h"
#include "apps/workbench/project/watch.h"
#include "calib/files/frame_images.h"

namespace plenocal::workbench {

class Api {
 public:
  Api(Project* project, Jobs* jobs, EventLog* events);

  Answer Handle(const Request& request);
  /// While the folders are watched: calibrates with the images that have arrived. Called again and
  /// again.
  void CalibrateArrivals();

 private:
  Answer AnswerTo(const Request& request);
  Answer State();
  Answer Files(const Request& request) const;
  Answer AddImage(const Request& request);
  std::string FolderFor(const std::string& camera, const std::string& name);
  Answer SessionRequest(const Request& request);
  Answer SessionAnswer(const SessionVersion& version);
  Answer Changed(const std::optional<SessionVersion>& version);
  Answer Exclude(const Request& request);
  Answer UseModel(const Request& request);
  Answer SetField(const Request& request);
  void WriteTarget(const std::string& text);
  [[nodiscard]] std::filesystem::path TargetFile(const std::string& text) const;
  [[nodiscard]] Answer Tried() const;
  Answer AddJob(const Request& request);
  nlohmann::json AddCalibration(int run);
  Answer WatchRequest(const Request& request);
  Answer Look(const Request& request);
  Answer Keep(const Request& request);
  void RenewWith(const std::vector<Arrival>& arrived);
  Answer Image(const Request& request);
  Answer Focus(const Request& request) const;
  Answer Run(const Request& request);
  Answer Straight(const Request& request);
  Answer Suggest(const Request& request) const;
  Answer Compare(const Request& request) const;
  Answer Export(const Request& request) const;
  Answer DrawTarget();
  Answer Sheet(const Request& request) const;
  nlohmann::json FocusJob(const nlohmann::json& body);
  /// Content of a YAML file in the root; null where there is none.
  [[nodiscard]] nlohmann::ordered_json FileJson(const std::filesystem::path& name) const;
  /// Of a camera and frame of the session; nothing where it has none.
  std::optional<FrameImage> FindImage(const std::string& camera, const std::string& frame);
  /// A camera's file in the folder of a run, which no link leaves.
  [[nodiscard]] std::filesystem::path RunFile(int run, const std::string& name) const;
  [[nodiscard]] nlohmann::json PngFolder(const SessionCamera& camera) const;
  nlohmann::json CamerasJson(const Session& session);

  Project* project_;
  Jobs* jobs_;
  EventLog* events_;
  SessionImages images_;
  Watch watch_;
  LiveLook live_;
  std::atomic<bool> has_arrivals_{false};  // that no calibration has begun with
  std::atomic<int> watched_run_{0};        // that the images which arrive are calibrated into
  std::mutex drawing_;                     // one tab at a time draws the target
};

}  // namespace plenocal::workbench
