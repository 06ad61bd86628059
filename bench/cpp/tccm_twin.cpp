// A plain C++ twin of tccm_ros.mapping: the same algorithm and the same arithmetic, step by step,
// with nothing between the steps. It is what the compiled Python is measured against, and it must
// give the same cuboids bit for bit. g++ -O3 -ffp-contract=off -shared -fPIC
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

namespace {

constexpr int64_t kTile = 64, kTileCells = kTile * kTile, kLow = 0xFFFFFFFFll, kLast = 1ll << 62;
constexpr double kShift = 1073741824.0;
constexpr int64_t kUnshift = 1ll << 30, kBeyond = 1ll << 40;
constexpr int kBlock = 512, kDigitBits = 8;

struct Word2 { int64_t a, b; };
struct Bounds { int32_t bottom, top; };
struct Moments { int64_t v[10]; };
struct Piece { int32_t bottom, top, cycle, index; };

struct Part {
  int32_t cycle = 0;
  std::vector<int64_t> keys;
  std::vector<Bounds> bounds;
  std::unique_ptr<Moments[]> moments;  // not zeroed first, as a vector would be
  std::unique_ptr<int64_t[]> seen;     // stamps of the first and the last scan
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
  int64_t lowest = kBeyond, highest = -kBeyond;
  int32_t used[kBlock], tile_of[kBlock], cell_of[kBlock], height[kBlock], place[kBlock], depth_of[kBlock];
  // closing
  std::vector<int64_t> cells, found_keys, stamps;
  std::vector<int32_t> starts, addresses, order, scans, firsts;
  std::vector<uint64_t> pairs, spare_pairs;
  std::vector<int8_t> begins;
  std::vector<Bounds> bounds;
  int64_t histogram[2][1 << kDigitBits];
  // map
  std::vector<Part> parts;
  std::vector<int64_t> keys, spare_keys;
  std::vector<Piece> pieces, spare;
  size_t n_pieces = 0;
  std::vector<Composite> composites;
};

void cover(Twin& t, int64_t box_x0, int64_t box_x1, int64_t box_y0, int64_t box_y1) {
  // Six tiles around what asks for it, and all that was covered before.
  int64_t x0 = box_x0 + t.tile_x0 - 6, x1 = box_x1 + t.tile_x0 + 7;
  int64_t y0 = box_y0 + t.tile_y0 - 6, y1 = box_y1 + t.tile_y0 + 7;
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

// The box of tiles and the heights of a block.
struct Box { int64_t x0 = kBeyond, x1 = -kBeyond, y0 = kBeyond, y1 = -kBeyond, low = kBeyond, high = -kBeyond; };

// What a point at (px, py, pz), in ticks, is in whole ticks. Branch-free.
inline void quantise(Twin& t, int j, bool used, double px, double py, double pz, double depth,
                     int64_t cell, double per_tick, Box& box) {
  const double far = kShift - 1.0;
  used = used & (std::fabs(px) < far) & (std::fabs(py) < far) & (std::fabs(pz) < far);
  px = used ? px : 0.0; py = used ? py : 0.0; pz = used ? pz : 0.0;
  const int64_t x = int64_t(int32_t(px + (kShift + 0.5))) - kUnshift;
  const int64_t y = int64_t(int32_t(py + (kShift + 0.5))) - kUnshift;
  const int64_t z = int64_t(int32_t(pz + (kShift + 0.5))) - kUnshift;
  const int64_t ix = int64_t(int32_t((x + 0.5) * per_tick + kShift)) - kUnshift;
  const int64_t iy = int64_t(int32_t((y + 0.5) * per_tick + kShift)) - kUnshift;
  const int64_t tx = (ix >> 6) - t.tile_x0, ty = (iy >> 6) - t.tile_y0;
  t.used[j] = used;
  t.tile_of[j] = int32_t(tx * t.n_y + ty);
  t.cell_of[j] = int32_t(((ix & 63) << 6) | (iy & 63));
  t.height[j] = int32_t(z);
  t.place[j] = int32_t(((x - ix * cell) << 16) | (y - iy * cell));
  t.depth_of[j] = int32_t(depth);
  box.x0 = std::min(box.x0, used ? tx : box.x0); box.x1 = std::max(box.x1, used ? tx : box.x1);
  box.y0 = std::min(box.y0, used ? ty : box.y0); box.y1 = std::max(box.y1, used ? ty : box.y1);
  box.low = std::min(box.low, used ? z : box.low); box.high = std::max(box.high, used ? z : box.high);
}

// Take in a block's box; whether the directory covers it. If not, it does now.
bool widen(Twin& t, const Box& b) {
  if (b.x0 > b.x1) return true;
  t.lowest = std::min(t.lowest, b.low); t.highest = std::max(t.highest, b.high);
  if (b.x0 >= 0 && b.y0 >= 0 && b.x1 < t.n_x && b.y1 < t.n_y) return true;
  cover(t, b.x0, b.x1, b.y0, b.y1);
  return false;
}

void count(Twin& t, int low, int high) {
  for (int j = low; j < high; ++j) {
    if (!t.used[j]) continue;
    const int64_t tile = t.tile_of[j];
    int64_t slot = t.directory[tile];
    if (slot < 0) {
      slot = t.slots++;
      if (size_t(t.slots * kTileCells) > t.counts.size()) {
        t.counts.resize(2 * t.slots * kTileCells);
        t.bits.resize(2 * t.slots * kTile);
        t.tiles.resize(2 * t.slots);
      }
      t.directory[tile] = int32_t(slot);
      t.tiles[slot] = int32_t(tile);
    }
    const int64_t cell = t.cell_of[j], address = slot * kTileCells + cell;
    ++t.counts[address];
    t.bits[address >> 6] |= 1ull << (cell & 63);
    t.records[t.n++] = {(int64_t(t.height[j]) << 32) | uint32_t(t.place[j]),
                        (int64_t(t.depth_of[j]) << 32) | address};
  }
}

// Beams [low, high) of the block that begins with beam `first`.
Box place(Twin& t, const float* __restrict ranges, const float* __restrict cosines,
          const float* __restrict sines, const double* T0, const double* T1, double f0, double df,
          double growth, int first, int low, int high) {
  const float g0 = float(f0), dg = float(df);
  float a[3][2], b[3][2];
  double o[3], d[3];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 2; ++j) {
      a[i][j] = float(T0[4 * i + j]);
      b[i][j] = float(T1[4 * i + j] - T0[4 * i + j]);
    }
    const double move = T1[4 * i + 3] - T0[4 * i + 3];
    o[i] = T0[4 * i + 3] + move * f0;
    d[i] = move * df;
  }
  const double ticks = t.ticks, least = t.depth, most = t.max_depth, per_tick = 1.0 / t.cell;
  const int64_t cell = int64_t(t.cell);
  Box box;
  for (int j = low; j < high; ++j) {
    const int i = first + j;
    const float r = ranges[i], f = g0 + dg * float(i), u = r * cosines[i], v = r * sines[i];
    const float x = (a[0][0] + f * b[0][0]) * u + (a[0][1] + f * b[0][1]) * v;
    const float y = (a[1][0] + f * b[1][0]) * u + (a[1][1] + f * b[1][1]) * v;
    const float z = (a[2][0] + f * b[2][0]) * u + (a[2][1] + f * b[2][1]) * v;
    double depth = growth * r;
    depth = depth > least ? depth : least;
    depth = depth < most ? depth : most;
    quantise(t, j, t.used[j], (x + (o[0] + d[0] * i)) * ticks, (y + (o[1] + d[1] * i)) * ticks,
             (z + (o[2] + d[2] * i)) * ticks, depth, cell, per_tick, box);
  }
  return box;
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

// Marks the n beams from `first` on that hit inside the region; the first and the last of them.
void mark_inside(Twin& t, const float* __restrict ranges, const uint8_t* __restrict keep,
                 const float* __restrict cosines, const float* __restrict sines, const Seen& seen,
                 int first, int n, int& low, int& high) {
  const Seen s = seen;
  int from = kBlock, to = -1;
  for (int j = 0; j < n; ++j) {
    const int i = first + j;
    const float k = float(i), u = ranges[i] * cosines[i], v = ranges[i] * sines[i];
    bool inside = keep[i];
    for (int c = 0; c < 3; ++c)
      inside = inside & (std::fabs((s.a[c] + k * s.c[c]) * u + (s.b[c] + k * s.d[c]) * v + (s.p[c] + k * s.q[c])) <= s.h[c]);
    t.used[j] = inside;
    from = std::min(from, inside ? j : kBlock);
    to = std::max(to, inside ? j : -1);
  }
  low = from;
  high = to + 1;
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
  if (t.records.size() < t.n + n) t.records.resize(2 * (t.n + n));
  const float *cosines = directions, *sines = directions + n;
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
    Seen seen;
    if (t.has_region) seen = region_from(T_ob + 16 * (n_knots / 2), T0, T1, f0, df, t.region);
    for (int begin = start; begin < end; begin += kBlock) {
      int low = 0, high = std::min(end - begin, kBlock);
      if (t.has_region) mark_inside(t, ranges, keep, cosines, sines, seen, begin, high, low, high);
      else for (int b = 0; b < high; ++b) t.used[b] = keep[begin + b];
      if (low >= high) continue;
      while (!widen(t, place(t, ranges, cosines, sines, T0, T1, f0, df, growth, begin, low, high))) {}
      count(t, low, high);
    }
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
  t.cells.resize(t.n); t.starts.resize(t.n + 1); t.addresses.resize(t.n);
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
          t.cells[n] = (((t.tile_x0 + tx) * kTile + lx) << 32) + (t.tile_y0 + column[j]) * kTile + bit;
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

// By rising height, equal ones as they came: radix sort, lowest digit first.
void order_by_height(Twin& t) {
  const size_t n = t.n;
  t.pairs.resize(n); t.spare_pairs.resize(n); t.order.resize(n);
  if (n == 0) return;
  int bits = 0;
  while ((t.highest - t.lowest) >> bits) ++bits;
  const int passes = std::max((bits + kDigitBits - 1) / kDigitBits, 1);
  const int width = (bits + passes - 1) / passes;
  const uint64_t size = 1ull << width, mask = size - 1;
  uint64_t *pairs = t.pairs.data(), *spare = t.spare_pairs.data();
  std::memset(t.histogram, 0, sizeof t.histogram);
  for (size_t i = 0; i < n; ++i) {
    const uint64_t height = uint64_t((t.records[i].a >> 32) - t.lowest);
    pairs[i] = (height << 32) | i;
    ++t.histogram[0][height & mask];
  }
  for (int p = 0; p < passes; ++p) {
    const int shift = 32 + p * width;
    int64_t *here = t.histogram[p & 1], *next = t.histogram[1 - (p & 1)], position = 0;
    for (uint64_t b = 0; b < size; ++b) {
      const int64_t c = here[b];
      here[b] = position;
      next[b] = 0;
      position += c;
    }
    if (p < passes - 1) {
      for (size_t i = 0; i < n; ++i) {
        const uint64_t pair = pairs[i];
        spare[here[(pair >> shift) & mask]++] = pair;
        ++next[(pair >> (shift + width)) & mask];
      }
      std::swap(pairs, spare);
    } else {
      for (size_t i = 0; i < n; ++i) t.order[here[(pairs[i] >> shift) & mask]++] = int32_t(pairs[i]);
    }
  }
}

void close_part(Twin& t, int32_t cycle) {
  const size_t n = t.n, n_cells = list_cells(t);
  order_by_height(t);
  t.points.resize(n); t.scans.resize(n);
  for (size_t i = 0, scan = 0; scan < t.ends.size(); ++scan)
    for (; i < size_t(t.ends[scan]); ++i) t.scans[i] = int32_t(scan);
  for (size_t j = 0; j < n; ++j) {
    const Word2 w = t.records[t.order[j]];
    t.points[t.counts[w.b & kLow]++] = {w.a, (w.b & ~kLow) | t.scans[t.order[j]]};
  }
  t.begins.assign(n + 1, 0);
  for (size_t c = 0; c < n_cells; ++c) {
    t.begins[t.starts[c]] = -1;
    t.counts[t.addresses[c]] = 0;
  }
  t.begins[n] = -1;
  // Masks, -1 or 0, where a branch could not be predicted.
  t.found_keys.resize(n); t.bounds.resize(n); t.firsts.resize(n);
  const Word2* p = t.points.data();
  size_t k = n, cell = n_cells;
  int64_t reach = 0, top = 0;
  for (size_t i = n; i-- > 0;) {
    const int64_t z = p[i].a >> 32, bottom = z - (p[i].b >> 32);
    const int64_t left = t.begins[i + 1], is_new = left | ((z - reach) >> 63);
    t.begins[i + 1] = int8_t(is_new);
    k += is_new;
    cell += left;
    top ^= (top ^ z) & is_new;
    const int64_t lower = bottom - reach;
    reach += lower & ((lower >> 63) | is_new);
    t.found_keys[k] = t.cells[cell];
    t.bounds[k] = {int32_t(reach), int32_t(top)};
    t.firsts[k] = int32_t(i);
  }
  t.begins[0] = -1;
  Part part;
  part.cycle = cycle;
  const size_t m = n - k;
  part.keys.assign(t.found_keys.begin() + k, t.found_keys.begin() + n);
  part.bounds.assign(t.bounds.begin() + k, t.bounds.begin() + n);
  part.moments.reset(new Moments[m]); part.seen.reset(new int64_t[2 * m]);
  t.stamps.resize(t.ends.size());
  int64_t* sums = reinterpret_cast<int64_t*>(part.moments.get());
  int64_t a[10] = {0}, low = 0, high = 0, c = -1;
  for (size_t i = 0; i < n; ++i) {
    const int64_t is_new = t.begins[i], kept = ~is_new, w = p[i].a, scan = p[i].b & kLow;
    const int64_t x = (w >> 16) & 0xFFFF, y = w & 0xFFFF, z = w >> 32;
    c -= is_new;
    const int64_t own[10] = {1, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z};
    for (int q = 0; q < 10; ++q) sums[10 * c + q] = a[q] = (a[q] & kept) + own[q];
    low += (scan - low) & (((scan - low) >> 63) | is_new);
    high += (scan - high) & (((high - scan) >> 63) | is_new);
    part.seen[2 * c] = t.stamps[low];
    part.seen[2 * c + 1] = t.stamps[high];
  }
  for (int64_t s = 0; s < t.slots; ++s) t.directory[t.tiles[s]] = -1;
  t.slots = 0; t.n = 0; t.ends.clear(); t.has_normal = false;
  t.lowest = kBeyond; t.highest = -kBeyond;
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
    if (j < n_new) { key = newest.keys[j]; low = newest.bounds[j].bottom; high = newest.bounds[j].top; }
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
    const double w = double(q.top - q.bottom) / double(part.bounds[q.index].top - part.bounds[q.index].bottom);
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
  const double ticks = t.ticks, per_tick = 1.0 / t.cell;
  for (int begin = 0; begin < n; begin += kBlock) {
    const int block = std::min(n - begin, kBlock);
    const double* p = xyz + 3 * begin;
    Box box;
    do {
      box = Box();
      for (int j = 0; j < block; ++j)
        quantise(t, j, true, p[3 * j] * ticks, p[3 * j + 1] * ticks, p[3 * j + 2] * ticks, t.depth, cell, per_tick, box);
    } while (!widen(t, box));
    count(t, 0, block);
  }
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
  std::memcpy(bounds, part.bounds.data(), part.bounds.size() * sizeof(Bounds));
  std::memcpy(moments, part.moments.get(), part.keys.size() * sizeof(Moments));
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
