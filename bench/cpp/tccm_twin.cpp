// A plain C++ twin of tccm_ros.mapping: the same algorithm and the same arithmetic, step by step,
// with nothing between the steps. It is what the compiled Python is measured against, and it must
// give the same cuboids bit for bit. g++ -O3 -ffp-contract=off -shared -fPIC
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

namespace {

constexpr int64_t kTile = 64, kTileCells = kTile * kTile, kLow = 0xFFFFFFFFll, kLast = 1ll << 62;
constexpr double kShift = 1073741824.0;
constexpr int64_t kUnshift = 1ll << 30;
constexpr int kMaxBins = 4096, kFew = 12;

struct Word2 { int64_t a, b; };
struct Bounds { int32_t cell, bottom, top, first; };
struct Moments { int64_t v[10]; };
struct Piece { int32_t bottom, top, cycle, index; };

struct Part {
  int32_t cycle = 0;
  std::vector<int64_t> keys;
  std::vector<int32_t> bounds;  // bottom, top
  std::vector<Moments> moments;
  std::vector<int64_t> seen;  // first, last scan
};

struct Composite { int32_t ix, iy, bottom, top; double m[10]; };

struct Twin {
  double ticks, cell, depth, factor, max_depth, region[6];
  bool has_region;
  int window;
  // binning
  int64_t tile_x0 = 0, tile_y0 = 0, n_x = 0, n_y = 0, slots = 0;
  std::vector<int32_t> directory, tiles, counts;
  std::vector<uint64_t> bits;
  std::vector<Word2> records, points;
  size_t n = 0;
  std::vector<int32_t> ends;
  double normal[3];
  bool has_normal = false;
  std::vector<float> x, y, z, outside;
  // closing
  std::vector<int32_t> cell_xy, starts, addresses;
  std::vector<Bounds> bounds;
  std::vector<Moments> moments;
  std::vector<int64_t> bins;
  std::vector<int32_t> scans;
  // map
  std::vector<Part> parts;
  std::vector<int64_t> keys, spare_keys;
  std::vector<Piece> pieces, spare;
  size_t n_pieces = 0;
  std::vector<Composite> composites;
};

void cover(Twin& t, double px, double py) {
  // Six tiles around whatever asks for it, and all that was covered before.
  const double tile = t.cell * kTile / t.ticks;
  int64_t x0 = int64_t(std::floor(px / tile)) - 6, x1 = x0 + 13;
  int64_t y0 = int64_t(std::floor(py / tile)) - 6, y1 = y0 + 13;
  if (t.slots) {
    x0 = std::min(x0, t.tile_x0); x1 = std::max(x1, t.tile_x0 + t.n_x);
    y0 = std::min(y0, t.tile_y0); y1 = std::max(y1, t.tile_y0 + t.n_y);
  }
  std::vector<int32_t> grown((x1 - x0) * (y1 - y0), -1);
  for (int64_t s = 0; s < t.slots; ++s) {
    const int64_t tx = t.tiles[s] / t.n_y + t.tile_x0, ty = t.tiles[s] % t.n_y + t.tile_y0;
    t.tiles[s] = int32_t((tx - x0) * (y1 - y0) + ty - y0);
    grown[t.tiles[s]] = int32_t(s);
  }
  t.directory.swap(grown);
  t.tile_x0 = x0; t.tile_y0 = y0; t.n_x = x1 - x0; t.n_y = y1 - y0;
}

inline void bin_point(Twin& t, double px, double py, double pz, double d, int64_t cell,
                      double inverse) {
  const int64_t x = int64_t(px * t.ticks + (kShift + 0.5)) - kUnshift;
  const int64_t y = int64_t(py * t.ticks + (kShift + 0.5)) - kUnshift;
  const int64_t z = int64_t(pz * t.ticks + (kShift + 0.5)) - kUnshift;
  const int64_t ix = int64_t((x + 0.5) * inverse + kShift) - kUnshift;
  const int64_t iy = int64_t((y + 0.5) * inverse + kShift) - kUnshift;
  int64_t tx = (ix >> 6) - t.tile_x0, ty = (iy >> 6) - t.tile_y0;
  if (uint64_t(tx) >= uint64_t(t.n_x) || uint64_t(ty) >= uint64_t(t.n_y)) {
    cover(t, px, py);
    tx = (ix >> 6) - t.tile_x0; ty = (iy >> 6) - t.tile_y0;
  }
  int64_t slot = t.directory[tx * t.n_y + ty];
  if (slot < 0) {
    slot = t.slots++;
    if (size_t(t.slots * kTileCells) > t.counts.size()) {
      t.counts.resize(2 * t.slots * kTileCells);
      t.bits.resize(2 * t.slots * kTile);
      t.tiles.resize(2 * t.slots);
    }
    t.directory[tx * t.n_y + ty] = int32_t(slot);
    t.tiles[slot] = int32_t(tx * t.n_y + ty);
  }
  const int64_t row = slot * kTile + (ix & 63), address = row * kTile + (iy & 63);
  if (t.counts[address]++ == 0) t.bits[row] |= 1ull << (iy & 63);
  const int64_t depth = int64_t(std::min(std::max(t.depth, d), t.max_depth));
  t.records[t.n++] = {(z << 32) | ((x - ix * cell) << 16) | (y - iy * cell),
                      (depth << 32) | address};
}

void place(const float* __restrict ranges, const float* __restrict cosines,
           const float* __restrict sines, const float* __restrict number, const double* T0,
           const double* T1, double f0, double df, int first, int last, float* __restrict x,
           float* __restrict y, float* __restrict z) {
  const float g0 = float(f0), dg = float(df);
  float a[3][2], b[3][2];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 2; ++j) {
      a[i][j] = float(T0[4 * i + j]);
      b[i][j] = float(T1[4 * i + j] - T0[4 * i + j]);
    }
  for (int i = first; i < last; ++i) {
    const float f = g0 + dg * number[i], u = ranges[i] * cosines[i], v = ranges[i] * sines[i];
    x[i] = (a[0][0] + f * b[0][0]) * u + (a[0][1] + f * b[0][1]) * v;
    y[i] = (a[1][0] + f * b[1][0]) * u + (a[1][1] + f * b[1][1]) * v;
    z[i] = (a[2][0] + f * b[2][0]) * u + (a[2][1] + f * b[2][1]) * v;
  }
}

// The region as beam 0 sees it: columns cosine, sine and place, how each changes per beam, half size.
struct Seen { float a[3], b[3], c[3], d[3], p[3], q[3], h[3]; };

Seen region_from(const double* base, const double* T0, const double* T1, double f0, double df,
                 const double* region) {
  Seen s;
  float* rows[3] = {s.a, s.b, s.p};
  float* moves[3] = {s.c, s.d, s.q};
  const int columns[3] = {0, 1, 3};
  for (int i = 0; i < 3; ++i) {
    s.h[i] = float(0.5 * (region[2 * i + 1] - region[2 * i]));
    for (int c = 0; c < 3; ++c) {
      const int column = columns[c];
      double at = 0.0, move = 0.0;
      for (int j = 0; j < 3; ++j) {
        const double r = base[4 * j + i];
        double begin = T0[4 * j + column];
        if (column == 3) begin -= base[4 * j + 3];
        const double turn = T1[4 * j + column] - T0[4 * j + column];
        at += r * (begin + f0 * turn);
        move += r * df * turn;
      }
      if (column == 3) at -= 0.5 * (region[2 * i] + region[2 * i + 1]);
      rows[c][i] = float(at);
      moves[c][i] = float(move);
    }
  }
  return s;
}

void distance_outside(const float* __restrict ranges, const float* __restrict cosines,
                      const float* __restrict sines, const float* __restrict number, const Seen& seen,
                      int first, int last, float* __restrict outside) {
  const Seen s = seen;
  for (int i = first; i < last; ++i) {
    const float k = number[i], u = ranges[i] * cosines[i], v = ranges[i] * sines[i];
    float w[3];
    for (int c = 0; c < 3; ++c)
      w[c] = std::fabs((s.a[c] + k * s.c[c]) * u + (s.b[c] + k * s.d[c]) * v + (s.p[c] + k * s.q[c])) - s.h[c];
    outside[i] = std::max(std::max(w[0], w[1]), w[2]);
  }
}

void add_scan(Twin& t, const float* ranges, const uint8_t* keep, const float* directions,
              const double* times, const double* T_ob, const double* T_bl, int n_knots, int n,
              double step) {
  std::vector<double> T(12 * n_knots);
  for (int k = 0; k < n_knots; ++k) {
    const double *A = T_ob + 16 * k, *B = T_bl + 16 * k;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 4; ++j) {
        double v = A[4 * i] * B[j] + A[4 * i + 1] * B[4 + j];
        v += A[4 * i + 2] * B[8 + j];
        T[12 * k + 4 * i + j] = j == 3 ? v + A[4 * i + 3] : v;
      }
  }
  const double* middle = &T[12 * (n_knots / 2)];
  double line = step;
  if (t.has_normal) {
    double square = 0.0;
    for (int i = 0; i < 3; ++i) {
      const double d = middle[4 * i + 2] - t.normal[i];
      square += d * d;
    }
    line = std::max(step, std::sqrt(square));
  }
  const double growth = t.factor * t.ticks * line;
  t.x.resize(n); t.y.resize(n); t.z.resize(n); t.outside.assign(n, 0.0f);
  if (t.records.size() < t.n + n) t.records.resize(2 * (t.n + n));
  const float *cosines = directions, *sines = directions + n, *number = directions + 2 * n;
  const int64_t cell = int64_t(t.cell);
  const double inverse = 1.0 / t.cell;
  int start = 0;
  for (int k = 0; k < std::max(n_knots - 1, 1); ++k) {
    int end = n, j = k;
    double f0 = 0.0, df = 0.0;
    if (n_knots > 1) {
      j = k + 1;
      df = 1.0 / (times[j] - times[k]);
      f0 = -times[k] * df;
      if (j < n_knots - 1) end = std::min(std::max(int(std::ceil(times[j])), start), n);
    }
    const double *T0 = &T[12 * k], *T1 = &T[12 * j];
    int from = start, to = end;
    if (t.has_region) {
      const Seen seen = region_from(T_ob + 16 * (n_knots / 2), T0, T1, f0, df, t.region);
      distance_outside(ranges, cosines, sines, number, seen, start, end, t.outside.data());
      while (from < to && !(t.outside[from] <= 0.0f)) ++from;
      while (from < to && !(t.outside[to - 1] <= 0.0f)) --to;
    }
    double origin[3], drift[3];
    for (int i = 0; i < 3; ++i) {
      drift[i] = (T1[4 * i + 3] - T0[4 * i + 3]) * df;
      origin[i] = T0[4 * i + 3] + (T1[4 * i + 3] - T0[4 * i + 3]) * f0;
    }
    place(ranges, cosines, sines, number, T0, T1, f0, df, from, to, t.x.data(), t.y.data(),
          t.z.data());
    for (int i = from; i < to; ++i)
      if (keep[i] && t.outside[i] <= 0.0f)
        bin_point(t, t.x[i] + (origin[0] + drift[0] * i), t.y[i] + (origin[1] + drift[1] * i),
                  t.z[i] + (origin[2] + drift[2] * i), growth * ranges[i], cell, inverse);
    start = end;
  }
  for (int i = 0; i < 3; ++i) t.normal[i] = middle[4 * i + 2];
  t.has_normal = true;
  t.ends.push_back(int32_t(t.n));
}

size_t list_cells(Twin& t) {
  size_t n = 0;
  int32_t position = 0;
  std::vector<int64_t> row(t.n_y), column(t.n_y);
  t.cell_xy.resize(2 * t.n); t.starts.resize(t.n + 1); t.addresses.resize(t.n);
  for (int64_t tx = 0; tx < t.n_x; ++tx) {
    int64_t in_row = 0;
    for (int64_t ty = 0; ty < t.n_y; ++ty)
      if (const int64_t slot = t.directory[tx * t.n_y + ty]; slot >= 0) {
        row[in_row] = slot;
        column[in_row++] = ty;
      }
    if (!in_row) continue;
    for (int64_t lx = 0; lx < kTile; ++lx)
      for (int64_t j = 0; j < in_row; ++j) {
        uint64_t word = t.bits[row[j] * kTile + lx];
        t.bits[row[j] * kTile + lx] = 0;
        while (word) {
          const int64_t bit = __builtin_ctzll(word);
          word &= word - 1;
          const int64_t address = (row[j] * kTile + lx) * kTile + bit;
          t.cell_xy[2 * n] = int32_t((t.tile_x0 + tx) * kTile + lx);
          t.cell_xy[2 * n + 1] = int32_t((t.tile_y0 + column[j]) * kTile + bit);
          t.starts[n] = position;
          t.addresses[n] = int32_t(address);
          position += t.counts[address];
          t.counts[address] = t.starts[n++];
        }
      }
  }
  t.starts[n] = position;
  return n;
}

void sum_points(const Word2* p, size_t first, size_t last, int64_t* m, int32_t* scans) {
  int64_t sx = 0, sy = 0, sz = 0, xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
  int64_t low = p[first].b & kLow, high = low;
  for (size_t i = first; i < last; ++i) {
    const int64_t w = p[i].a, x = (w >> 16) & 0xFFFF, y = w & 0xFFFF, z = w >> 32;
    sx += x; sy += y; sz += z;
    xx += x * x; xy += x * y; xz += x * z; yy += y * y; yz += y * z; zz += z * z;
    low = std::min(low, p[i].b & kLow);
    high = std::max(high, p[i].b & kLow);
  }
  scans[0] = int32_t(low);
  scans[1] = int32_t(high);
  const int64_t all[10] = {int64_t(last - first), sx, sy, sz, xx, xy, xz, yy, yz, zz};
  std::memcpy(m, all, sizeof all);
}

void sort_falling(Word2* p, int64_t first, int64_t last) {
  int64_t gap = 1;
  while (gap < (last - first) / 9) gap = 3 * gap + 1;
  for (; gap > 0; gap /= 3)
    for (int64_t i = first + gap; i < last; ++i) {
      const Word2 w = p[i];
      int64_t j = i;
      for (; j >= first + gap && p[j - gap].a < w.a; j -= gap) p[j] = p[j - gap];
      p[j] = w;
    }
}

void bin_falling(Twin& t, Word2* p, int64_t first, int64_t last, int64_t top, int shift,
                 int64_t n_bins) {
  std::fill(t.bins.begin(), t.bins.begin() + n_bins, 0);
  Word2* spare = t.records.data();
  for (int64_t i = first; i < last; ++i) {
    ++t.bins[(top - (p[i].a >> 32)) >> shift];
    spare[i - first] = p[i];
  }
  int64_t position = first;
  for (int64_t b = 0; b < n_bins; ++b) {
    const int64_t count = t.bins[b];
    t.bins[b] = position;
    position += count;
  }
  for (int64_t i = 0; i < last - first; ++i) p[t.bins[(top - (spare[i].a >> 32)) >> shift]++] = spare[i];
}

void close_part(Twin& t, int32_t cycle) {
  const size_t n = t.n, cells = list_cells(t);
  t.points.resize(n);
  for (size_t i = 0, scan = 0; scan < t.ends.size(); ++scan)
    for (; i < size_t(t.ends[scan]); ++i) {
      const int64_t w = t.records[i].b;
      t.points[t.counts[w & kLow]++] = {t.records[i].a, (w & ~kLow) | int64_t(scan)};
    }
  t.bounds.resize(n); t.moments.resize(n); t.scans.resize(2 * n); t.bins.resize(kMaxBins);
  int shift = 0;
  while ((2ll << shift) <= int64_t(t.depth)) ++shift;
  Word2* p = t.points.data();
  size_t k = n;
  auto emit = [&](int64_t cell, int64_t bottom, int64_t top, size_t a, size_t b) {
    t.bounds[--k] = {int32_t(cell), int32_t(bottom), int32_t(top), int32_t(a)};
    sum_points(p, a, b, t.moments[k].v, &t.scans[2 * k]);
  };
  for (int64_t cell = int64_t(cells) - 1; cell >= 0; --cell) {
    const int64_t first = t.starts[cell], last = t.starts[cell + 1];
    t.counts[t.addresses[cell]] = 0;
    int64_t top = p[first].a >> 32, low = top, bottom = top - (p[first].b >> 32), reach = bottom;
    for (int64_t i = first + 1; i < last; ++i) {
      const int64_t z = p[i].a >> 32, b = z - (p[i].b >> 32);
      reach = z > top ? b : (z == top ? std::min(reach, b) : reach);
      top = std::max(top, z); low = std::min(low, z); bottom = std::min(bottom, b);
    }
    if (low >= reach) { emit(cell, bottom, top, first, last); continue; }
    const int64_t n_bins = ((top - low) >> shift) + 1;
    const bool binned = last - first > kFew && n_bins <= kMaxBins;
    if (binned) bin_falling(t, p, first, last, top, shift, n_bins);
    else sort_falling(p, first, last);
    int64_t start = first, high = 0, lowest = 0;
    for (int64_t i = first, j; i < last; i = j) {
      int64_t z = p[i].a >> 32, d = z - (p[i].b >> 32);
      j = i + 1;
      if (binned)
        for (const int64_t b = (top - z) >> shift; j < last && (top - (p[j].a >> 32)) >> shift == b; ++j) {
          const int64_t other = p[j].a >> 32;
          z = std::max(z, other);
          d = std::min(d, other - (p[j].b >> 32));
        }
      if (i == first) { high = z; lowest = d; }
      else if (z >= lowest) lowest = std::min(lowest, d);
      else { emit(cell, lowest, high, start, i); start = i; high = z; lowest = d; }
    }
    emit(cell, lowest, high, start, last);
  }
  Part part;
  part.cycle = cycle;
  const size_t m = n - k;
  part.keys.resize(m); part.bounds.resize(2 * m);
  part.seen.assign(t.scans.begin() + 2 * k, t.scans.begin() + 2 * n);
  part.moments.assign(t.moments.begin() + k, t.moments.begin() + n);
  for (size_t i = 0; i < m; ++i) {
    const Bounds& b = t.bounds[k + i];
    part.keys[i] = (int64_t(t.cell_xy[2 * b.cell]) << 32) + t.cell_xy[2 * b.cell + 1];
    part.bounds[2 * i] = b.bottom; part.bounds[2 * i + 1] = b.top;
  }
  for (int64_t s = 0; s < t.slots; ++s) t.directory[t.tiles[s]] = -1;
  t.slots = 0; t.n = 0; t.ends.clear(); t.has_normal = false;
  t.parts.push_back(std::move(part));
}

void merge_part(Twin& t) {
  const Part& part = t.parts.back();
  while (t.parts.front().cycle <= part.cycle - t.window) t.parts.erase(t.parts.begin());
  const Part& newest = t.parts.back();
  const size_t n_new = newest.keys.size(), room = t.n_pieces + 2 * n_new + 1;
  if (t.spare.size() < room) { t.spare.resize(room + room / 2); t.spare_keys.resize(room + room / 2); }
  const int32_t oldest = t.parts.front().cycle, cycle = newest.cycle;
  int64_t* out_keys = t.spare_keys.data();
  Piece* out = t.spare.data();
  size_t n = 0, j = 0;
  int64_t key = kLast, low = kLast, high = kLast, cell = kLast, cover = 0;
  auto next = [&] {
    if (j < n_new) { key = newest.keys[j]; low = newest.bounds[2 * j]; high = newest.bounds[2 * j + 1]; }
    else key = low = high = kLast;
  };
  auto put = [&](int64_t c, int64_t bottom, int64_t top, int32_t from, int32_t index) {
    out_keys[n] = c;
    out[n] = {int32_t(bottom), int32_t(top), from, index};
  };
  next();
  for (size_t i = 0; i < t.n_pieces; ++i) {
    const int64_t here = t.keys[i];
    if (here != cell) {
      while (key < here) { put(key, low, high, cycle, int32_t(j)); ++n; ++j; next(); }
      cell = here;
      cover = -kLast;
    }
    const Piece& old = t.pieces[i];
    int64_t bottom = std::max(int64_t(old.bottom), cover);
    const int64_t top = old.top;
    const bool kept = old.cycle >= oldest;
    int64_t end = key == here ? std::min(top, low) : top;
    put(here, bottom, end, old.cycle, old.index);
    n += kept & (end > bottom);
    while (key == here && low < top) {
      put(key, low, high, cycle, int32_t(j));
      ++n; ++j;
      cover = high;
      next();
      bottom = std::max(bottom, cover);
      end = key == here ? std::min(top, low) : top;
      put(here, bottom, end, old.cycle, old.index);
      n += kept & (end > bottom);
    }
  }
  while (j < n_new) { put(key, low, high, cycle, int32_t(j)); ++n; ++j; next(); }
  t.keys.swap(t.spare_keys);
  t.pieces.swap(t.spare);
  t.n_pieces = n;
}

void compose(Twin& t) {
  t.composites.clear();
  std::vector<const Part*> by_cycle;
  const int32_t first = t.parts.front().cycle;
  for (const Part& p : t.parts) { by_cycle.resize(p.cycle - first + 1); by_cycle.back() = &p; }
  for (size_t i = 0; i < t.n_pieces; ++i) {
    const Piece& q = t.pieces[i];
    const Part& part = *by_cycle[q.cycle - first];
    const double w = double(q.top - q.bottom) / double(part.bounds[2 * q.index + 1] - part.bounds[2 * q.index]);
    if (!i || t.keys[i] != t.keys[i - 1] || q.bottom != t.pieces[i - 1].top) {
      const int64_t ix = (t.keys[i] + (1ll << 31)) >> 32;
      t.composites.push_back({int32_t(ix), int32_t(t.keys[i] - (ix << 32)), q.bottom, 0, {}});
    }
    Composite& c = t.composites.back();
    c.top = q.top;
    for (int j = 0; j < 10; ++j) c.m[j] += w * double(part.moments[q.index].v[j]);
  }
}

}  // namespace

extern "C" {

void* twin_new(double cell, double depth, double factor, double max_depth, const double* region, int window) {
  Twin* t = new Twin;
  t->ticks = 10000.0; t->cell = cell; t->depth = depth; t->factor = factor; t->max_depth = max_depth;
  t->has_region = region != nullptr;
  if (region) std::copy(region, region + 6, t->region);
  t->window = window;
  return t;
}

void twin_delete(void* p) { delete static_cast<Twin*>(p); }

// Scans of equal length follow each other; knots are the same number for all.
void twin_scans(void* p, const float* ranges, const uint8_t* keep, const float* directions,
                const double* times, const double* T_ob, const double* T_bl, int scans, int knots,
                int beams, double step) {
  for (int s = 0; s < scans; ++s)
    add_scan(*static_cast<Twin*>(p), ranges + s * beams, keep + s * beams, directions,
             times + s * knots, T_ob + 16 * s * knots, T_bl + 16 * s * knots, knots, beams, step);
}

void twin_points(void* p, const double* xyz, int n) {
  Twin& t = *static_cast<Twin*>(p);
  if (t.records.size() < t.n + n) t.records.resize(2 * (t.n + n));
  const int64_t cell = int64_t(t.cell);
  const double inverse = 1.0 / t.cell;
  for (int i = 0; i < n; ++i)
    if (std::isfinite(xyz[3 * i] + xyz[3 * i + 1] + xyz[3 * i + 2]))
      bin_point(t, xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2], 0.0, cell, inverse);
  t.ends.push_back(int32_t(t.n));
}

int twin_close(void* p, int cycle) {
  close_part(*static_cast<Twin*>(p), cycle);
  return int(static_cast<Twin*>(p)->parts.back().keys.size());
}

// A part map without an integration map.
int twin_part_alone(void* p) {
  Twin& t = *static_cast<Twin*>(p);
  t.parts.clear();
  close_part(t, 0);
  return int(t.parts.back().keys.size());
}

int twin_merge(void* p) { merge_part(*static_cast<Twin*>(p)); return int(static_cast<Twin*>(p)->n_pieces); }

int twin_compose(void* p) { compose(*static_cast<Twin*>(p)); return int(static_cast<Twin*>(p)->composites.size()); }

void twin_read_part(void* p, int64_t* keys, int32_t* bounds, int64_t* moments) {
  const Part& part = static_cast<Twin*>(p)->parts.back();
  std::copy(part.keys.begin(), part.keys.end(), keys);
  std::copy(part.bounds.begin(), part.bounds.end(), bounds);
  std::memcpy(moments, part.moments.data(), part.moments.size() * sizeof(Moments));
}

void twin_read_pieces(void* p, int64_t* keys, int32_t* pieces) {
  const Twin& t = *static_cast<Twin*>(p);
  std::copy(t.keys.begin(), t.keys.begin() + t.n_pieces, keys);
  std::memcpy(pieces, t.pieces.data(), t.n_pieces * sizeof(Piece));
}

void twin_read_composites(void* p, double* moments) {
  for (const Composite& c : static_cast<Twin*>(p)->composites) moments = std::copy(c.m, c.m + 10, moments);
}

}  // extern "C"
