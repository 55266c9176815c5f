/* The plain loops of METHOD §2, compiled: the same integers as possmap/core/stamping.py.

   Doubles are computed in the order in which METHOD §2 writes them and must not be contracted
   (-ffp-contract=off). Segments come as rows of doubles (possmap/core/pyramid.py), pieces as
   rows of 64-bit integers (possmap/core/kernel.py); arrays cross the border as buffers, so that
   this file needs neither NumPy's headers nor its ABI. */

#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030b0000
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define HAIR 1e-6        /* lattice.HAIR */
#define FULL 65535.0     /* pyramid.FULL */
#define TILE 256         /* lattice.TILE */
#define AT_ONCE 512      /* stamping.LISTED_AT_ONCE */
#define KNOTS 6001       /* swath.normal_table: so many ... */
#define PER_UNIT 500     /* ... from -6 to 6 */
#define LEAST 1e-12      /* swath._LEAST */
#define LANES 8          /* 16-bit numbers in the narrowest vector of today's machines */

enum {
    X0, Y0, X1, Y1, HALF_X0, HALF_Y0, HALF_X1, HALF_Y1, MAX_ERROR, WIDTH, IS_POINT, FACTOR, COLUMNS
};
enum { SEGMENT, FIRST, LAST, GROUP, KNOWN, CLIP, PIECE_COLUMNS };
enum { NORMAL_X, NORMAL_Y, OFFSET, TOUCH, ONE_SIDED, LINE_COLUMNS }; /* clip.line_table */
enum { UP_TO, SHARE, SLOPE, KNOT };                                  /* swath.normal_table */

typedef int64_t i64;

typedef struct {
    i64 row, column;
    double half_x, half_y;
} Stamp;

typedef struct { /* values of the cells of a window, and its place on the lattice */
    uint16_t *values;
    i64 row0, column0, rows, columns;
} Block;

typedef struct { /* what the pieces of a call share */
    const double *segments, *lines, *knots;
    const i64 *starts; /* the lines of clip i are starts[i]..starts[i + 1]-1 */
    double c;
    uint16_t *room;    /* four times the block's longer side, for profiles */
    uint16_t *apart;   /* as large as the block and blank, for pyramids that are clipped */
} Shared;

static i64 least(i64 a, i64 b) { return a < b ? a : b; }
static i64 most(i64 a, i64 b) { return a > b ? a : b; }

/* ------------------------------------------------------------------ the stamps of a segment */

static i64 count_of(const double *s, double c) /* pyramid.count_of */
{
    double longest = fmax(fabs(s[X1] - s[X0]), fabs(s[Y1] - s[Y0]));
    return most(1, (i64)ceil(longest / c - HAIR));
}

static Stamp stamp_at(const double *s, i64 n, i64 k, double c) /* pyramid.stamps */
{
    double share = (double)k / (double)n;
    Stamp at;
    at.row = (i64)floor((s[Y0] + share * (s[Y1] - s[Y0])) / c + HAIR);
    at.column = (i64)floor((s[X0] + share * (s[X1] - s[X0])) / c + HAIR);
    at.half_x = s[HALF_X0] + share * (s[HALF_X1] - s[HALF_X0]);
    at.half_y = s[HALF_Y0] + share * (s[HALF_Y1] - s[HALF_Y0]);
    return at;
}

static i64 reach_of(double half, double c) { return (i64)ceil(half / c + 0.5) - 1; }

static int too_wide(const double *s, i64 n, i64 k)
{
    double share = (double)k / (double)most(1, n);
    for (int side = 0; side < 2; side++) {
        double half0 = s[HALF_X0 + side], half1 = s[HALF_X1 + side];
        if (half0 + share * (half1 - half0) >= s[MAX_ERROR]) return 1;
    }
    return 0;
}

static void span_of(const double *s, double c, i64 *first, i64 *last) /* pyramid.relevant */
{
    i64 n = s[IS_POINT] != 0 ? 0 : count_of(s, c);
    double limit = s[MAX_ERROR];
    *first = 0, *last = n;
    for (int side = 0; side < 2; side++) {
        double half0 = s[HALF_X0 + side], half1 = s[HALF_X1 + side];
        if (fmin(half0, half1) >= limit) {
            *first = 0, *last = -1;
            return;
        }
        if (fmax(half0, half1) > limit) {
            double crossing = (double)n * ((limit - half0) / (half1 - half0));
            if (half1 > half0)
                *last = least(*last, (i64)ceil(crossing) + 1);
            else
                *first = most(*first, (i64)floor(crossing) - 1);
        }
    }
    while (*first <= *last && too_wide(s, n, *first)) ++*first;
    while (*first <= *last && too_wide(s, n, *last)) --*last;
    if (*first > *last) *first = 0, *last = -1;
}

/* ------------------------------------------------------------------ the pyramid of a stamp */

/* Return the profile of the cells from..to-1 along one axis: floor(65535·N + 0.5) of each, and
   then a vector of zeros. It is the same on both sides of the centre: computed once, and written
   both ways from the middle of a room for two sides. */
static const uint16_t *profile(uint16_t *middle, i64 from, i64 to, i64 centre, double half,
                               double max_error, double c)
{
    double height = 1 - half / max_error, base = half + c / 2;
    height = height > 0 ? height : 0;
    i64 before = from - centre, after = to - 1 - centre;
    i64 nearest = before > 0 ? before : after < 0 ? -after : 0;
    double start = (double)nearest;
    int count = (int)(most(-before, after) - nearest + 1);
    for (int i = 0; i < count; i++) {
        double slope = 1 - (start + i) * c / base;
        slope = slope > 0 ? slope : 0;
        middle[i] = middle[-i] = (uint16_t)(int)(FULL * (height * slope) + 0.5);
    }
    uint16_t *out = before > 0 ? middle : middle + before + nearest;
    memset(out + (to - from), 0, LANES * sizeof *out);
    return out;
}

/* Raise so many times so many cells of a line to the least of ``across`` and ``up``. The plainest
   vectors of 16 bits know a maximum and no minimum, hence the sum. */
static inline void raise_line(uint16_t *restrict line, const uint16_t *restrict across, uint16_t up,
                              i64 times, i64 cells)
{
    for (; times > 0; times--, line += cells, across += cells)
        for (i64 j = 0; j < cells; j++) {
            uint16_t larger = across[j] > up ? across[j] : up;
            uint16_t value = (uint16_t)(across[j] + up - larger);
            line[j] = line[j] > value ? line[j] : value;
        }
}

/* Raise a block to the maximum of itself and the stamps first..last of a segment. ``room`` holds
   four times the block's longer side. */
static void raise_block(const Block *b, const double *s, i64 first, i64 last, double c,
                        uint16_t *room)
{
    i64 n = count_of(s, c), longer = most(b->rows, b->columns) + LANES;
    const uint16_t *end = b->values + b->rows * b->columns;
    for (i64 k = first; k <= last; k++) {
        Stamp at = stamp_at(s, n, k, c);
        i64 reach_rows = reach_of(at.half_y, c), reach_columns = reach_of(at.half_x, c);
        i64 bottom = most(at.row - reach_rows, b->row0);
        i64 top = least(at.row + reach_rows + 1, b->row0 + b->rows);
        i64 left = most(at.column - reach_columns, b->column0);
        i64 right = least(at.column + reach_columns + 1, b->column0 + b->columns);
        if (bottom >= top || left >= right) continue;
        const uint16_t *up =
            profile(room + longer, bottom, top, at.row, at.half_y, s[MAX_ERROR], c);
        const uint16_t *across =
            profile(room + 3 * longer, left, right, at.column, at.half_x, s[MAX_ERROR], c);
        /* Whole vectors: beyond the stamp they raise to 0, which changes nothing. */
        i64 whole = (right - left + LANES - 1) / LANES * LANES;
        uint16_t *line = b->values + (bottom - b->row0) * b->columns + (left - b->column0);
        for (i64 row = 0; row < top - bottom; row++, line += b->columns) {
            if (whole <= end - line)
                raise_line(line, across, up[row], whole / LANES, LANES);
            else
                raise_line(line, across, up[row], 1, right - left);
        }
    }
}

/* ------------------------------------------------------------------ the extent of a piece */

/* How many rows and columns from its centre a stamp may say something (stamping, swath.reach). */
static void reach_at(const double *s, const Stamp *at, double growth, double c, i64 *rows,
                     i64 *columns)
{
    if (s[WIDTH] > 0) {
        double metres = 2 * (at->half_x + at->half_y + growth);
        *rows = *columns = (i64)ceil((metres + fmax(s[WIDTH], c)) / c) + 1;
    } else {
        *rows = reach_of(at->half_y, c), *columns = reach_of(at->half_x, c);
    }
}

static double growth_of(const double *s)
{
    return fabs(s[HALF_X1] - s[HALF_X0]) + fabs(s[HALF_Y1] - s[HALF_Y0]);
}

typedef struct { i64 low[2], high[2]; } Extent; /* rows and columns of a block, low..high-1 */

/* Grow an extent on the lattice by what a piece may touch (stamping.extent): cells are monotone
   along a segment, and so are reaches, but not always both together. */
static void extend(Extent *e, const double *s, const i64 *piece, double c)
{
    i64 n = count_of(s, c), a_row, a_column, b_row, b_column;
    double growth = growth_of(s) / (double)n;
    Stamp one = stamp_at(s, n, piece[FIRST], c), other = stamp_at(s, n, piece[LAST], c);
    reach_at(s, &one, growth, c, &a_row, &a_column);
    reach_at(s, &other, growth, c, &b_row, &b_column);
    i64 rows = most(a_row, b_row), columns = most(a_column, b_column);
    e->low[0] = least(e->low[0], least(one.row, other.row) - rows);
    e->low[1] = least(e->low[1], least(one.column, other.column) - columns);
    e->high[0] = most(e->high[0], most(one.row, other.row) + rows + 1);
    e->high[1] = most(e->high[1], most(one.column, other.column) + columns + 1);
}

/* Return the rows and columns of a block that pieces may touch. */
static Extent extent_of(const Block *b, const Shared *with, const i64 *piece, const i64 *end)
{
    Extent e = {{INT64_MAX, INT64_MAX}, {INT64_MIN, INT64_MIN}};
    for (; piece < end; piece += PIECE_COLUMNS)
        extend(&e, with->segments + piece[SEGMENT] * COLUMNS, piece, with->c);
    e.low[0] = most(e.low[0] - b->row0, 0), e.high[0] = least(e.high[0] - b->row0, b->rows);
    e.low[1] = most(e.low[1] - b->column0, 0);
    e.high[1] = least(e.high[1] - b->column0, b->columns);
    return e;
}

/* ------------------------------------------------------------------ clips and swaths */

typedef struct { const double *from, *to; } Lines;

static Lines lines_of(const Shared *with, const i64 *piece)
{
    Lines none = {NULL, NULL};
    if (piece[CLIP] < 0) return none;
    Lines found = {with->lines + with->starts[piece[CLIP]] * LINE_COLUMNS,
                   with->lines + with->starts[piece[CLIP] + 1] * LINE_COLUMNS};
    return found;
}

/* Whether a path must say nothing of the cell with its centre at (x, y) (clip.spared). */
static int is_spared(Lines lines, double x, double y)
{
    for (const double *line = lines.from; line < lines.to; line += LINE_COLUMNS) {
        double distance = line[NORMAL_Y] * y + (line[NORMAL_X] * x - line[OFFSET]);
        if ((line[ONE_SIDED] != 0 ? distance : fabs(distance)) <= line[TOUCH]) return 1;
    }
    return 0;
}

/* The normal distribution up to z: np.interp over the knots, whose last slope is 0. */
static double normal_share(const double *knots, double z)
{
    if (!(z > knots[UP_TO])) return knots[SHARE];
    if (z >= knots[(KNOTS - 1) * KNOT + UP_TO]) return knots[(KNOTS - 1) * KNOT + SHARE];
    const double *at = knots + (int)((z - knots[UP_TO]) * PER_UNIT) * KNOT;
    while (z < at[UP_TO]) at -= KNOT;
    while (z >= at[KNOT + UP_TO]) at += KNOT;
    return at[SLOPE] * (z - at[UP_TO]) + at[SHARE];
}

static double between(const double *knots, double upper, double lower)
{
    return normal_share(knots, upper) - normal_share(knots, lower);
}

/* Narrow low..high to where a·x lies between two numbers. */
static void narrow(double *low, double *high, double a, double least_ax, double largest_ax)
{
    if (a != 0) {
        double one = least_ax / a, other = largest_ax / a;
        *low = fmax(*low, fmin(one, other)), *high = fmin(*high, fmax(one, other));
    } else if (least_ax > 0 || largest_ax < 0) {
        *high = -INFINITY;
    }
}

/* Raise cells of a block to what a segment's swath says (swath.sweep), but for the spared ones.
   The extent of a piece is generous: of each row only the columns within reach of the path are
   looked at, and a quarter of a cell beyond, for rounding. */
static void sweep(const Block *b, const Shared *with, const double *s, Extent e, Lines lines)
{
    double c = with->c, half = fmax(s[WIDTH], c) / 2 + HAIR * c;
    double step_x = s[X1] - s[X0], step_y = s[Y1] - s[Y0];
    double length = sqrt(step_x * step_x + step_y * step_y);
    double ahead_x = length != 0 ? step_x / length : 1, ahead_y = length != 0 ? step_y / length : 0;
    double size_x = fabs(ahead_x), size_y = fabs(ahead_y);
    double widest_x = fmax(s[HALF_X0], s[HALF_X1]), widest_y = fmax(s[HALF_Y0], s[HALF_Y1]);
    double aside = size_y * widest_x + size_x * widest_y + half + c / 4;
    double before = size_x * widest_x + size_y * widest_y + half + c / 4;
    i64 first, last, n = count_of(s, c);
    span_of(s, c, &first, &last);
    for (i64 row = e.low[0]; row < e.high[0]; row++) {
        double centre_y = ((double)(b->row0 + row) + 0.5) * c, y = centre_y - s[Y0];
        double low = ((double)(b->column0 + e.low[1]) + 0.5) * c - s[X0];
        double high = ((double)(b->column0 + e.high[1] - 1) + 0.5) * c - s[X0], origin = low;
        narrow(&low, &high, ahead_y, y * ahead_x - aside, y * ahead_x + aside);
        narrow(&low, &high, ahead_x, -before - y * ahead_y, length + before - y * ahead_y);
        if (!(low <= high)) continue;
        i64 from = e.low[1] + (i64)floor((low - origin) / c);
        i64 to = least(e.high[1], e.low[1] + (i64)ceil((high - origin) / c) + 1);
        uint16_t *line = b->values + row * b->columns;
        for (i64 column = from; column < to; column++) {
            double centre_x = ((double)(b->column0 + column) + 0.5) * c, x = centre_x - s[X0];
            double along = x * ahead_x + y * ahead_y, across = fabs(y * ahead_x - x * ahead_y);
            double share = length != 0 ? fmin(fmax(along, 0), length) / length : 0;
            double half_x = s[HALF_X0] + share * (s[HALF_X1] - s[HALF_X0]);
            double half_y = s[HALF_Y0] + share * (s[HALF_Y1] - s[HALF_Y0]);
            if (!(half_x < s[MAX_ERROR] && half_y < s[MAX_ERROR])) continue;
            if (!(across <= size_y * half_x + size_x * half_y + half)) continue;
            if (!(fmax(fmax(-along, along - length), 0)
                  <= size_x * half_x + size_y * half_y + half))
                continue;
            double stamp = floor(share * (double)n);
            if (!(stamp + 1 >= (double)first && stamp <= (double)last)) continue;
            if (is_spared(lines, centre_x, centre_y)) continue;
            double ax = ahead_y * half_x, ay = ahead_x * half_y;
            double sharp_across = s[FACTOR] / fmax(sqrt(ax * ax + ay * ay), LEAST);
            double lx = ahead_x * half_x, ly = ahead_y * half_y;
            double sharp_along = s[FACTOR] / fmax(sqrt(lx * lx + ly * ly), LEAST);
            double value = between(with->knots, (half - across) * sharp_across,
                                   (-half - across) * sharp_across);
            value *= between(with->knots, (along + half) * sharp_along,
                             (along - length - half) * sharp_along);
            uint16_t found = (uint16_t)(int)(FULL * value + 0.5);
            line[column] = line[column] > found ? line[column] : found;
        }
    }
}

/* Raise a block to the maximum of itself and a piece, but where its clip spares cells. */
static void raise_piece(const Block *b, const Shared *with, const i64 *piece)
{
    const double *s = with->segments + piece[SEGMENT] * COLUMNS;
    Lines lines = lines_of(with, piece);
    if (s[WIDTH] > 0) {
        sweep(b, with, s, extent_of(b, with, piece, piece + PIECE_COLUMNS), lines);
        return;
    }
    if (lines.from == lines.to) {
        raise_block(b, s, piece[FIRST], piece[LAST], with->c, with->room);
        return;
    }
    Extent e = extent_of(b, with, piece, piece + PIECE_COLUMNS);
    Block apart = *b;
    apart.values = with->apart;
    raise_block(&apart, s, piece[FIRST], piece[LAST], with->c, with->room);
    for (i64 row = e.low[0]; row < e.high[0]; row++) {
        double y = ((double)(b->row0 + row) + 0.5) * with->c;
        for (i64 column = e.low[1]; column < e.high[1]; column++) {
            i64 at = row * b->columns + column;
            if (apart.values[at] > b->values[at]
                && !is_spared(lines, ((double)(b->column0 + column) + 0.5) * with->c, y))
                b->values[at] = apart.values[at];
            apart.values[at] = 0;
        }
    }
}

/* ------------------------------------------------------------------ what Python calls */

#define FARTHEST 4e15 /* cells: beyond, doubles know no single cell */

/* Whether a buffer is whole rows of doubles that can be cells; sets an error if not. */
static int are_segments(const Py_buffer *segments, double c)
{
    const double *s = segments->buf;
    i64 count = segments->len / (i64)(COLUMNS * sizeof(double));
    int sound = segments->itemsize == (Py_ssize_t)sizeof(double)
                && segments->len % (i64)(COLUMNS * sizeof(double)) == 0 && c > 0 && isfinite(c);
    for (; sound && count > 0; count--, s += COLUMNS) {
        double widest = 0;
        for (int i = 0; i < COLUMNS; i++) sound = sound && isfinite(s[i]);
        for (int i = X0; i <= Y1; i++) sound = sound && fabs(s[i]) < FARTHEST * c;
        for (int i = HALF_X0; i <= HALF_Y1; i++) widest = s[i] > widest ? s[i] : widest;
        sound = sound && (widest < FARTHEST * c || s[MAX_ERROR] < FARTHEST * c);
    }
    if (!sound) PyErr_SetString(PyExc_ValueError, "segments that are on no lattice");
    return sound;
}

enum { BLOCK, SEGMENTS, PIECES, LINES, STARTS, KNOTTED, TABLE, BUFFERS };

typedef struct {
    Py_buffer view[BUFFERS];
    Block b;
    Shared with;
    const i64 *pieces, *end;
} Call;

static i64 rows_of(const Py_buffer *view, i64 columns) /* of 64-bit numbers; -1: no whole rows */
{
    return view->len % (columns * 8) ? -1 : view->len / (columns * 8);
}

/* Return what is wrong with the numbers of a call, or NULL. */
static const char *fault_of(const Call *call, i64 cell)
{
    const Block *b = &call->b;
    const Shared *with = &call->with;
    i64 segments = rows_of(&call->view[SEGMENTS], COLUMNS);
    i64 lines = rows_of(&call->view[LINES], LINE_COLUMNS), starts = rows_of(&call->view[STARTS], 1);
    if (rows_of(&call->view[PIECES], PIECE_COLUMNS) < 0) return "pieces that are no whole rows";
    if (b->rows <= 0 || b->columns <= 0 || call->view[BLOCK].len / cell / b->columns != b->rows
        || call->view[BLOCK].len % (cell * b->columns))
        return "the block is not of its window's shape";
    if (lines < 0 || starts < 1 || with->starts[0] != 0 || with->starts[starts - 1] != lines)
        return "lines that are no whole clips";
    for (i64 i = 1; i < starts; i++)
        if (with->starts[i] < with->starts[i - 1]) return "lines that are no whole clips";
    for (const i64 *piece = call->pieces; piece < call->end; piece += PIECE_COLUMNS) {
        if (piece[SEGMENT] < 0 || piece[SEGMENT] >= segments) return "a piece of no segment";
        if (piece[CLIP] >= starts - 1) return "a piece of no clip";
        if (with->segments[piece[SEGMENT] * COLUMNS + WIDTH] > 0
            && call->view[KNOTTED].len != KNOTS * KNOT * (i64)sizeof(double))
            return "a swath without the normal distribution";
    }
    return NULL;
}

/* Take what Python hands over: buffers in the order of the enumeration above. Whatever comes back,
   close_call must follow; -1: an error is set. */
static int open_call(Call *call, PyObject *const objects[BUFFERS], i64 cell, double c)
{
    for (int i = 0; i < BUFFERS; i++)
        if (objects[i]
            && PyObject_GetBuffer(objects[i], &call->view[i],
                                  i == BLOCK ? PyBUF_WRITABLE | PyBUF_C_CONTIGUOUS
                                             : PyBUF_C_CONTIGUOUS) < 0)
            return -1;
    if (!are_segments(&call->view[SEGMENTS], c)) return -1;
    call->with.segments = call->view[SEGMENTS].buf, call->with.lines = call->view[LINES].buf;
    call->with.starts = call->view[STARTS].buf, call->with.knots = call->view[KNOTTED].buf;
    call->with.c = c, call->pieces = call->view[PIECES].buf;
    call->end = call->pieces + call->view[PIECES].len / (i64)sizeof(i64);
    const char *fault = fault_of(call, cell);
    if (fault) return PyErr_SetString(PyExc_ValueError, fault), -1;
    const Block *b = &call->b;
    int clipped = 0;
    for (const i64 *piece = call->pieces; piece < call->end; piece += PIECE_COLUMNS)
        clipped |= piece[CLIP] >= 0 && call->with.segments[piece[SEGMENT] * COLUMNS + WIDTH] == 0;
    call->with.room = malloc(4 * (size_t)(most(b->rows, b->columns) + LANES) * sizeof(uint16_t));
    if (clipped) call->with.apart = calloc((size_t)(b->rows * b->columns), sizeof(uint16_t));
    if (!call->with.room || (clipped && !call->with.apart)) return PyErr_NoMemory(), -1;
    return 0;
}

static PyObject *close_call(Call *call, int sound)
{
    free(call->with.room);
    free(call->with.apart);
    for (int i = 0; i < BUFFERS; i++) PyBuffer_Release(&call->view[i]);
    if (!sound) return NULL;
    Py_RETURN_NONE;
}

/* raise_(block, row0, column0, rows, columns, segments, pieces, lines, starts, knots, resolution) */
static PyObject *raise_(PyObject *self, PyObject *args)
{
    Call call;
    PyObject *o[BUFFERS] = {NULL};
    double c;
    long long row0, column0, rows, columns;
    (void)self;
    if (!PyArg_ParseTuple(args, "OLLLLOOOOOd", &o[BLOCK], &row0, &column0, &rows, &columns,
                          &o[SEGMENTS], &o[PIECES], &o[LINES], &o[STARTS], &o[KNOTTED], &c))
        return NULL;
    memset(&call, 0, sizeof call);
    call.b = (Block){NULL, row0, column0, rows, columns};
    if (open_call(&call, o, sizeof(uint16_t), c) < 0) return close_call(&call, 0);
    call.b.values = call.view[BLOCK].buf;
    for (const i64 *piece = call.pieces; piece < call.end; piece += PIECE_COLUMNS)
        raise_piece(&call.b, &call.with, piece);
    return close_call(&call, 1);
}

/* Add to weights, or take from them, the weight of every value of the block in an extent. */
static void weigh(i64 *weights, const Block *b, const Extent *e, const i64 *table, int sign)
{
    for (i64 row = e->low[0]; row < e->high[0]; row++)
        for (i64 at = row * b->columns + e->low[1]; at < row * b->columns + e->high[1]; at++)
            if (b->values[at]) weights[at] += sign * table[b->values[at]];
}

/* reinforce(weights, row0, column0, rows, columns, segments, pieces, lines, starts, knots, table,
   resolution): fusion's sum over the groups of pieces; the known ones of a group come first. */
static PyObject *reinforce(PyObject *self, PyObject *args)
{
    Call call;
    PyObject *o[BUFFERS] = {NULL};
    double c;
    long long row0, column0, rows, columns;
    (void)self;
    if (!PyArg_ParseTuple(args, "OLLLLOOOOOOd", &o[BLOCK], &row0, &column0, &rows, &columns,
                          &o[SEGMENTS], &o[PIECES], &o[LINES], &o[STARTS], &o[KNOTTED], &o[TABLE],
                          &c))
        return NULL;
    memset(&call, 0, sizeof call);
    call.b = (Block){NULL, row0, column0, rows, columns};
    int sound = open_call(&call, o, sizeof(i64), c) == 0;
    if (sound && call.view[TABLE].len != 65536 * (i64)sizeof(i64)) {
        PyErr_SetString(PyExc_ValueError, "not a table of 65536 weights");
        sound = 0;
    }
    if (sound) {
        call.b.values = calloc((size_t)(rows * columns) + LANES, sizeof(uint16_t));
        if (!call.b.values) PyErr_NoMemory(), sound = 0;
    }
    i64 *weights = call.view[BLOCK].buf;
    const i64 *piece = call.pieces, *table = call.view[TABLE].buf;
    while (sound && piece < call.end) {
        const i64 *next = piece;
        while (next < call.end && next[GROUP] == piece[GROUP]) next += PIECE_COLUMNS;
        Extent e = extent_of(&call.b, &call.with, piece, next);
        for (int known = 1; known >= 0; known--) {
            int any = 0;
            for (const i64 *one = piece; one < next; one += PIECE_COLUMNS)
                if ((one[KNOWN] != 0) == known) raise_piece(&call.b, &call.with, one), any = 1;
            if (any || !known) weigh(weights, &call.b, &e, table, known ? -1 : 1);
        }
        for (i64 row = e.low[0]; row < e.high[0]; row++)
            if (e.high[1] > e.low[1])
                memset(call.b.values + row * columns + e.low[1], 0,
                       (size_t)(e.high[1] - e.low[1]) * sizeof(uint16_t));
        piece = next;
    }
    if (sound) free(call.b.values);
    return close_call(&call, sound);
}

static i64 tile_of(i64 cell) { return cell >= 0 ? cell / TILE : -((-cell + TILE - 1) / TILE); }

typedef struct { i64 low_row, high_row, low_column, high_column; } Tiles;

/* touch(segments, resolution) -> bytes: rows of segment, tile row, tile column, first, last */
static PyObject *touch(PyObject *self, PyObject *args)
{
    Py_buffer segments;
    double c;
    (void)self;
    if (!PyArg_ParseTuple(args, "y*d", &segments, &c)) return NULL;
    if (!are_segments(&segments, c)) return PyBuffer_Release(&segments), NULL;
    i64 count = segments.len / (i64)(COLUMNS * sizeof(double)), held = 0, room = 5 * 1024;
    i64 *out = malloc((size_t)room * sizeof(i64));
    for (i64 i = 0; out && i < count; i++) {
        const double *s = (const double *)segments.buf + i * COLUMNS;
        i64 first, last, n = count_of(s, c);
        double growth = growth_of(s) / (double)n;
        span_of(s, c, &first, &last);
        for (i64 from = first; out && from <= last; from += AT_ONCE) {
            Tiles tiles[AT_ONCE], all = {INT64_MAX, INT64_MIN, INT64_MAX, INT64_MIN};
            i64 some = least(last - from + 1, AT_ONCE);
            for (i64 k = 0; k < some; k++) {
                Stamp at = stamp_at(s, n, from + k, c);
                i64 rows, columns;
                reach_at(s, &at, growth, c, &rows, &columns);
                Tiles t = {tile_of(at.row - rows), tile_of(at.row + rows),
                           tile_of(at.column - columns), tile_of(at.column + columns)};
                all.low_row = least(all.low_row, t.low_row);
                all.high_row = most(all.high_row, t.high_row);
                all.low_column = least(all.low_column, t.low_column);
                all.high_column = most(all.high_column, t.high_column);
                tiles[k] = t;
            }
            for (i64 row = all.low_row; out && row <= all.high_row; row++)
                for (i64 column = all.low_column; out && column <= all.high_column; column++) {
                    i64 one = -1, other = -1;
                    for (i64 k = 0; k < some; k++)
                        if (tiles[k].low_row <= row && row <= tiles[k].high_row
                            && tiles[k].low_column <= column && column <= tiles[k].high_column)
                            other = k, one = one < 0 ? k : one;
                    if (one < 0) continue;
                    if (held + 5 > room) {
                        i64 *more = realloc(out, (size_t)(room *= 2) * sizeof(i64));
                        if (!more) free(out);
                        out = more;
                        if (!out) break;
                    }
                    i64 found[5] = {i, row, column, from + one, from + other};
                    memcpy(out + held, found, sizeof found);
                    held += 5;
                }
        }
    }
    PyObject *found = out ? PyBytes_FromStringAndSize((char *)out, held * (i64)sizeof(i64))
                          : PyErr_NoMemory();
    free(out);
    PyBuffer_Release(&segments);
    return found;
}

static PyMethodDef methods[] = {
    {"raise_", raise_, METH_VARARGS, "Raise a block to the maximum of itself and pieces."},
    {"reinforce", reinforce, METH_VARARGS, "Add to weights those of each group's maximum."},
    {"touch", touch, METH_VARARGS, "Return the tiles that each segment may touch."},
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "_stamping", "The loops of METHOD 2, compiled.", 0, methods,
    NULL, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__stamping(void) { return PyModule_Create(&module); }
