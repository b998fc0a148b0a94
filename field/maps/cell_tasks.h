// The tasks of one batch of shading points, cell by cell, with copies of all that they refer to but for maps and
// radiance, which outlive them: what a wave of many batches keeps until it is answered.
//
// Memory layout: what tasks refer to lies kind by kind, in the order of the tasks. Thread-safety: values.
#pragma once

#include <span>
#include <vector>

#include "field/maps/cell_task.h"

namespace fieldtrace {

class CellTasks {
 public:
  CellTasks() = default;
  CellTasks(CellTasks&&) = default;  // what tasks refer to stays where it is
  CellTasks& operator=(CellTasks&&) = default;
  CellTasks(const CellTasks&) = delete;
  CellTasks& operator=(const CellTasks&) = delete;

  void add(const CellTask& task);
  // After the last add(): makes the tasks refer to the copies.
  void link();

  std::span<const CellTask> tasks() const { return tasks_; }
  std::span<const OwnLines> own() const { return own_; }
  std::span<const MapRadiance> own_radiance() const { return own_radiance_; }
  std::span<const MapLines> maps() const { return maps_; }
  std::span<const MapRadiance> map_radiance() const { return map_radiance_; }
  std::span<const PlaneLines> planes() const { return planes_; }
  std::span<const BallLines> balls() const { return balls_; }

 private:
  std::vector<CellTask> tasks_;
  std::vector<OwnLines> own_;
  std::vector<MapLines> maps_;
  std::vector<MapRadiance> own_radiance_, map_radiance_;
  std::vector<PlaneLines> planes_;
  std::vector<BallLines> balls_;
};

}  // namespace fieldtrace
