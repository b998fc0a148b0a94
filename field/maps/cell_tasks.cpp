#include "field/maps/cell_tasks.h"

namespace fieldtrace {
namespace {

template <class T>
void append(std::vector<T>& to, const T* from, int count) {
  to.insert(to.end(), from, from + count);
}

// The next `count` of a list.
template <class T>
const T* take(const std::vector<T>& list, size_t& next, int count) {
  const T* const first = list.data() + next;
  next += size_t(count);
  return first;
}

}  // namespace

void CellTasks::add(const CellTask& task) {
  CellTask& t = tasks_.emplace_back(task);
  if (!task.reflects) t.own_radiance = t.map_radiance = nullptr;
  if (task.own) own_.push_back(*task.own);
  if (t.own_radiance) own_radiance_.push_back(*task.own_radiance);
  if (t.map_radiance) append(map_radiance_, task.map_radiance, task.map_count);
  append(maps_, task.maps, task.map_count);
  append(planes_, task.planes, task.plane_count);
  append(balls_, task.balls, task.ball_count);
}

void CellTasks::link() {
  size_t own = 0, own_radiance = 0, maps = 0, map_radiance = 0, planes = 0, balls = 0;
  for (CellTask& t : tasks_) {
    if (t.own) t.own = take(own_, own, 1);
    if (t.own_radiance) t.own_radiance = take(own_radiance_, own_radiance, 1);
    if (t.map_radiance) t.map_radiance = take(map_radiance_, map_radiance, t.map_count);
    t.maps = take(maps_, maps, t.map_count);
    t.planes = take(planes_, planes, t.plane_count);
    t.balls = take(balls_, balls, t.ball_count);
  }
}

}  // namespace fieldtrace
