//! Binding to the AprilTag library of its authors (Wang and Olson 2016), version 3.4.5.
#![allow(unsafe_code)]

use apriltag_sys as sys;

use super::image::GreyImage;

#[derive(Clone, Copy)]
pub(super) enum Family {
    Tag36h11,
    Tag25h9,
    TagStandard41h12,
    Tag16h5,
}

type Create = unsafe extern "C" fn() -> *mut sys::apriltag_family_t;
type Destroy = unsafe extern "C" fn(*mut sys::apriltag_family_t);

impl Family {
    fn functions(self) -> (Create, Destroy) {
        match self {
            Family::Tag36h11 => (sys::tag36h11_create, sys::tag36h11_destroy),
            Family::Tag25h9 => (sys::tag25h9_create, sys::tag25h9_destroy),
            Family::TagStandard41h12 => (sys::tagStandard41h12_create, sys::tagStandard41h12_destroy),
            Family::Tag16h5 => (sys::tag16h5_create, sys::tag16h5_destroy),
        }
    }
}

pub(super) struct Found {
    pub id: usize,
    pub wrong_bits: usize,
    /// Decision margin, grey levels.
    pub margin: f64,
    /// Corners in the image, px.
    pub corners: [[f64; 2]; 4],
}

/// Detector of one family of tags, in one thread.
pub(super) struct Library {
    detector: *mut sys::apriltag_detector_t,
    family: *mut sys::apriltag_family_t,
    destroy: Destroy,
    /// Copy of the image, because the library takes a mutable one.
    pixels: Vec<u8>,
}

// SAFETY: only this value has its pointers, and the library keeps no state that belongs to a thread.
unsafe impl Send for Library {}

impl Library {
    /// Corrects `bits` wrong bits, at most 3, and reduces images by `decimate` for the search. None if memory runs out.
    pub(super) fn new(family: Family, bits: u8, decimate: f64) -> Option<Library> {
        let (create, destroy) = family.functions();
        // SAFETY: both constructors take nothing.
        let (family, detector) = unsafe { (create(), sys::apriltag_detector_create()) };
        if family.is_null() || detector.is_null() {
            return None;
        }
        let pixels = Vec::new();
        // SAFETY: neither pointer is null. The library owns neither the family nor the detector.
        unsafe {
            (*detector).quad_decimate = decimate as f32;
            sys::apriltag_detector_add_family_bits(detector, family, bits.min(3).into());
        }
        Some(Library {
            detector,
            family,
            destroy,
            pixels,
        })
    }
    pub(super) fn detect(&mut self, image: &GreyImage) -> Vec<Found> {
        self.pixels.clear();
        self.pixels.extend_from_slice(image.pixels());
        // An image has at most `MAX_SIDE_PX` a side.
        let mut image = sys::image_u8_t {
            width: image.width() as i32,
            height: image.height() as i32,
            stride: image.width() as i32,
            buf: self.pixels.as_mut_ptr(),
        };
        let mut all = Vec::new();
        // SAFETY: an image has a pixel for each column of each row, and both it and the detector outlive the call. The
        // result is an array of pointers to detections, which are valid until it is destroyed.
        unsafe {
            let array = sys::apriltag_detector_detect(self.detector, &mut image);
            if array.is_null() {
                return all;
            }
            let detections = (*array).data.cast::<*const sys::apriltag_detection_t>();
            for k in 0..(*array).size as usize {
                let found = &**detections.add(k);
                all.push(Found {
                    id: found.id as usize,
                    wrong_bits: found.hamming as usize,
                    margin: f64::from(found.decision_margin),
                    corners: found.p,
                });
            }
            sys::apriltag_detections_destroy(array);
        }
        all
    }
}

impl Drop for Library {
    fn drop(&mut self) {
        // SAFETY: nobody uses the pointers afterwards; the detector releases its table of the family first.
        unsafe {
            sys::apriltag_detector_destroy(self.detector);
            (self.destroy)(self.family);
        }
    }
}
