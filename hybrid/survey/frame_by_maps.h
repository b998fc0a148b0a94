// What finer direction maps gain in a picture.
#pragma once

namespace fieldtrace {

// A picture whose sky is answered by maps, as surveys foretell it. Mean squares are those of the picture's pixels.
struct FrameByMaps {
  double rays = 0.0;    // that it takes as long as, before maps are made
  double reads = 0.0;   // of maps and planes, in each direction
  double noise = 0.0;   // mean square
  double hidden = 0.0;  // of the light's mean square, the share that something hides

  // What maps of so many directions a side may cost more than ones of half as many, in rays: by as much the time to an
  // error falls. Negative where they cost more than they gain even if they are baked for nothing. `tolerance`: in units
  // of the default; below it maps may err by less.
  double worth_of_finer(int directions, double tolerance) const;
};

}  // namespace fieldtrace
